-- What a reader of the hub found (decision 190).

-- The month in which a run began, by the first 48 bits of its id; NULL if they have no time between 2020 and 2100. Records are
-- put into partitions by these bits, whatever the version of the id is.
CREATE OR REPLACE FUNCTION hub.month_of(run uuid) RETURNS timestamp
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
RETURN (
    SELECT CASE WHEN month >= '2020-01-01' AND month < '2100-01-01' THEN month END
    FROM (SELECT date_trunc('month', to_timestamp(
        ('x' || left(replace(run::text, '-', ''), 12))::bit(48)::bigint / 1000) AT TIME ZONE 'UTC') AS month) AS began
);
REVOKE ALL ON FUNCTION hub.month_of(uuid) FROM PUBLIC;

-- As in step 2; of ids of every version, and without a lock that waits until other benches commit.
CREATE OR REPLACE FUNCTION hub.make_partition(run uuid) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    month timestamp := hub.month_of(run);
    partition text := to_char(month, '"record_"YYYY_MM');
BEGIN
    IF month IS NULL THEN
        RETURN;
    END IF;
    -- Until the end of the transaction, so that a partition that is there now is there for the records too.
    LOCK TABLE ONLY hub.record IN ROW EXCLUSIVE MODE;
    IF to_regclass('hub.' || partition) IS NOT NULL THEN
        RETURN;
    END IF;
    -- One maker at a time; another one may have made it meanwhile.
    LOCK TABLE ONLY hub.record IN SHARE UPDATE EXCLUSIVE MODE;
    IF to_regclass('hub.' || partition) IS NOT NULL THEN
        RETURN;
    END IF;
    -- CREATE TABLE … PARTITION OF would wait for every transaction that writes records.
    EXECUTE format('CREATE TABLE hub.%I (LIKE hub.record INCLUDING DEFAULTS INCLUDING INDEXES)', partition);
    EXECUTE format('ALTER TABLE hub.record ATTACH PARTITION hub.%I FOR VALUES FROM (%L) TO (%L)',
                   partition, hub.first_id(month), hub.first_id(month + interval '1 month'));
END $$;

-- As in step 8; the table is locked first, as for records that come. A partition stays until the next call if others use the
-- table for longer than the time limit.
CREATE OR REPLACE FUNCTION hub.drop_empty_partitions() RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp SET lock_timeout = '5s' AS $$
DECLARE
    partition text;
    has_records boolean;
BEGIN
    FOR partition IN
        SELECT c.relname FROM pg_inherits AS i JOIN pg_class AS c ON c.oid = i.inhrelid
        WHERE i.inhparent = 'hub.record'::regclass AND c.relname ~ '^record_\d{4}_\d{2}$'
          AND c.relname < to_char(now() AT TIME ZONE 'UTC', '"record_"YYYY_MM')
    LOOP
        EXECUTE format('SELECT EXISTS (SELECT FROM hub.%I)', partition) INTO has_records;
        CONTINUE WHEN has_records;
        LOCK TABLE ONLY hub.record IN ACCESS EXCLUSIVE MODE;
        EXECUTE format('SELECT EXISTS (SELECT FROM hub.%I)', partition) INTO has_records;
        IF NOT has_records THEN
            EXECUTE format('DROP TABLE hub.%I', partition);
        END IF;
    END LOOP;
EXCEPTION WHEN lock_not_available THEN
    RAISE NOTICE 'rigd-hub: empty partitions stay: hub.record is in use';
END $$;

-- Records of the default partition whose id has a time: they would keep the partition of their month from being made.
DO $$
BEGIN
    LOCK TABLE hub.record_other IN ACCESS EXCLUSIVE MODE;
    CREATE TEMP TABLE stray ON COMMIT DROP AS
        SELECT * FROM hub.record_other AS r WHERE hub.month_of(r.run) IS NOT NULL;
    IF NOT EXISTS (SELECT FROM pg_temp.stray) THEN
        RETURN;
    END IF;
    DELETE FROM hub.record_other AS r WHERE hub.month_of(r.run) IS NOT NULL;
    PERFORM hub.make_partition(s.run) FROM (SELECT DISTINCT run FROM pg_temp.stray) AS s;
    -- They are no news of a rig.
    ALTER TABLE hub.record DISABLE TRIGGER live;
    INSERT INTO hub.record SELECT * FROM pg_temp.stray;
    ALTER TABLE hub.record ENABLE TRIGGER live;
END $$;

-- As in step 4; the row of a journal of another bench is not locked.
CREATE OR REPLACE FUNCTION hub.greet(wanted uuid, of_software text) RETURNS hub.cursor
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    own bigint := hub.own_bench();
    j hub.journal;
BEGIN
    IF own IS NULL THEN
        RAISE EXCEPTION 'role % is not that of a bench', session_user USING ERRCODE = 'insufficient_privilege';
    END IF;
    INSERT INTO hub.journal (id, bench, software) VALUES (wanted, own, of_software) ON CONFLICT DO NOTHING;
    SELECT * INTO j FROM hub.journal WHERE id = wanted AND bench = own FOR UPDATE;
    IF NOT FOUND THEN
        PERFORM hub.alert(own, 'stranger', wanted::text, format(
            'role %s ships a journal of %s', session_user,
            (SELECT b.role FROM hub.journal AS t JOIN hub.bench AS b ON b.id = t.bench WHERE t.id = wanted)));
        RETURN ROW(NULL, NULL, 'the journal is that of another bench')::hub.cursor;
    END IF;
    UPDATE hub.journal SET last_seen = now(), software = of_software WHERE id = wanted;
    RETURN ROW(j.cursor_event, encode(j.cursor_digest, 'hex'), j.quarantined)::hub.cursor;
END $$;

-- As in step 4; the row of a run of another bench is not locked.
CREATE OR REPLACE FUNCTION hub.take_entry(j hub.journal, e json) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    wanted uuid := (e ->> 'id')::uuid;
    held hub.run;
BEGIN
    IF wanted::text <> e ->> 'id' THEN
        RAISE EXCEPTION '% is not the id of a run as journals write it', e ->> 'id' USING ERRCODE = 'HB004';
    END IF;
    PERFORM hub.make_partition(wanted);
    INSERT INTO hub.run (id, bench, journal, origin_bench, origin_journal, kind, name, format, epoch, started_at)
    VALUES (wanted, j.bench, j.id, e ->> 'bench', e ->> 'journal', e ->> 'kind', e ->> 'name',
            (e ->> 'format')::bigint, (e ->> 'epoch')::bigint, e ->> 'started_at')
    ON CONFLICT DO NOTHING;
    SELECT * INTO held FROM hub.run WHERE id = wanted AND bench = j.bench FOR UPDATE;
    IF NOT FOUND THEN
        PERFORM hub.alert(j.bench, 'stranger', wanted::text, 'a run of another bench was shipped');
    ELSIF (held.origin_bench, held.origin_journal, held.kind, held.name, held.format, held.epoch, held.started_at)
          <> (e ->> 'bench', e ->> 'journal', e ->> 'kind', e ->> 'name', (e ->> 'format')::bigint,
              (e ->> 'epoch')::bigint, e ->> 'started_at') THEN
        PERFORM hub.alert(j.bench, 'clash', wanted::text, 'the list of runs of the journal has another entry: ' || e);
    END IF;
END $$;

-- The run of a record. It is locked if it is one of the bench that ships. Its partition is there also if the batch does not have
-- its entry.
CREATE OR REPLACE FUNCTION hub.run_of(j hub.journal, wanted uuid) RETURNS hub.run
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    found_run hub.run;
BEGIN
    SELECT * INTO found_run FROM hub.run WHERE id = wanted AND bench = j.bench FOR UPDATE;
    IF FOUND THEN
        PERFORM hub.make_partition(wanted);
        RETURN found_run;
    END IF;
    SELECT * INTO found_run FROM hub.run WHERE id = wanted;
    IF NOT FOUND THEN
        RAISE EXCEPTION 'run % has no entry', wanted USING ERRCODE = 'HB004';
    END IF;
    RETURN found_run;
END $$;
REVOKE ALL ON FUNCTION hub.run_of(hub.journal, uuid) FROM PUBLIC;

-- As in step 4; the row of a run of another bench is neither locked nor written.
CREATE OR REPLACE FUNCTION hub.ingest(journal uuid, after_event bigint, batch json) RETURNS hub.cursor
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    j hub.journal := hub.own_journal(journal);
    of_run hub.run;
    r json;
    event bigint;
    last bigint := after_event;
    last_digest bytea := decode(batch ->> 'after_digest', 'hex');
BEGIN
    IF j.quarantined IS NOT NULL THEN
        RAISE EXCEPTION 'journal % is quarantined: %', journal, j.quarantined USING ERRCODE = 'HB001';
    END IF;
    IF after_event > j.cursor_event THEN
        RAISE EXCEPTION 'the batch follows event %, and the hub has events up to %', after_event, j.cursor_event
            USING ERRCODE = 'HB002';
    END IF;
    IF after_event = j.cursor_event AND last_digest IS DISTINCT FROM j.cursor_digest THEN
        RAISE EXCEPTION 'the journal has another record at event %', after_event USING ERRCODE = 'HB003';
    END IF;
    PERFORM hub.take_entry(j, e) FROM json_array_elements(batch -> 'runs') AS e;
    PERFORM hub.take_stretch(j, s) FROM json_array_elements(batch -> 'stretches') AS s;
    FOR r IN SELECT * FROM json_array_elements(batch -> 'records') LOOP
        event := (r ->> 'event')::bigint;
        IF event <= last THEN
            RAISE EXCEPTION 'event % comes behind event %', event, last USING ERRCODE = 'HB004';
        END IF;
        last := event;
        last_digest := decode(r ->> 'digest', 'hex');
        IF event = j.cursor_event AND last_digest <> j.cursor_digest THEN
            RAISE EXCEPTION 'the journal has another record at event %', event USING ERRCODE = 'HB003';
        END IF;
        IF of_run.id IS DISTINCT FROM (r ->> 'run')::uuid THEN
            UPDATE hub.run SET records = of_run.records, head = of_run.head WHERE id = of_run.id AND bench = j.bench;
            of_run := hub.run_of(j, (r ->> 'run')::uuid);
        END IF;
        of_run := hub.take_record(j, of_run, r);
    END LOOP;
    UPDATE hub.run SET records = of_run.records, head = of_run.head WHERE id = of_run.id AND bench = j.bench;
    PERFORM hub.take_end(j, e) FROM json_array_elements(batch -> 'ends') AS e;
    IF EXISTS (
        SELECT FROM json_array_elements(batch -> 'records') AS s, hub.left_line AS l
        WHERE l.journal = j.id AND l.event = (s ->> 'event')::bigint AND l.digest = decode(s ->> 'digest', 'hex')
    ) THEN
        j.quarantined := 'two copies of the journal go on';
        PERFORM hub.alert(j.bench, 'quarantine', j.id::text, j.quarantined);
    END IF;
    IF last > j.cursor_event THEN
        j.cursor_event := last;
        j.cursor_digest := last_digest;
    END IF;
    UPDATE hub.journal
    SET cursor_event = j.cursor_event, cursor_digest = j.cursor_digest, quarantined = j.quarantined, last_seen = now()
    WHERE id = j.id;
    RETURN ROW(j.cursor_event, encode(j.cursor_digest, 'hex'), j.quarantined)::hub.cursor;
END $$;

-- As in step 3; runs are locked too, so that none is pruned between the removal of its rows and the reading of its records.
CREATE OR REPLACE FUNCTION hub.rebuild() RETURNS bigint
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    typed text;
    made bigint;
BEGIN
    LOCK TABLE hub.journal, hub.run IN EXCLUSIVE MODE;
    FOREACH typed IN ARRAY ARRAY['run_fact', 'sample', 'command', 'touch', 'fault', 'amendment', 'unread'] LOOP
        EXECUTE format('DELETE FROM hub.%I AS t
                        WHERE EXISTS (SELECT FROM hub.record AS r WHERE r.run = t.run AND r.seq = 1)', typed);
    END LOOP;
    PERFORM hub.make_typed(r.run, r.seq, r.kind, r.payload, hub.time_of(r.run, r.epoch, r.rig_us))
    FROM hub.record AS r
    WHERE hub.is_typed(r.kind);
    GET DIAGNOSTICS made = ROW_COUNT;
    RETURN made;
END $$;

-- Whether a record of this stretch was taken. A stretch comes with its first record; that of a copy of the journal stays without
-- one if its records were put aside.
CREATE OR REPLACE FUNCTION hub.has_records(of_run uuid, of_epoch bigint) RETURNS boolean
LANGUAGE sql STABLE STRICT
RETURN EXISTS (SELECT FROM hub.record AS r WHERE r.run = of_run AND r.epoch = of_epoch);
REVOKE ALL ON FUNCTION hub.has_records(uuid, bigint) FROM PUBLIC;

-- As in step 2; of the stretches with a record.
CREATE OR REPLACE FUNCTION hub.run_seal(run uuid, finished_at text, status text) RETURNS bytea
LANGUAGE sql STABLE STRICT
RETURN (
    SELECT sha256(
        hub.text_part(r.origin_bench) || hub.text_part(r.origin_journal) || hub.text_part(r.id::text)
        || hub.text_part(r.kind) || hub.text_part(r.name) || int8send(r.format) || int8send(r.epoch)
        || hub.text_part(r.started_at)
        || coalesce((
            SELECT string_agg(int8send(s.epoch) || hub.text_part(s.started_at) || int8send(s.rig_us), ''::bytea
                              ORDER BY s.epoch)
            FROM hub.stretch AS s WHERE s.run = r.id AND hub.has_records(s.run, s.epoch)), ''::bytea)
        || hub.text_part(run_seal.finished_at) || hub.text_part(run_seal.status) || int8send(r.records) || r.head)
    FROM hub.run AS r WHERE r.id = run_seal.run
);

-- As in step 4; one without a record is replaced.
CREATE OR REPLACE FUNCTION hub.take_stretch(j hub.journal, s json) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    r hub.run;
    held hub.stretch;
BEGIN
    SELECT * INTO r FROM hub.run WHERE id = (s ->> 'run')::uuid AND bench = j.bench;
    IF NOT FOUND THEN
        RETURN;
    END IF;
    IF r.seal IS NULL THEN
        INSERT INTO hub.stretch AS h
        VALUES (r.id, (s ->> 'epoch')::bigint, s ->> 'started_at', (s ->> 'rig_us')::bigint)
        ON CONFLICT (run, epoch) DO UPDATE SET started_at = excluded.started_at, rig_us = excluded.rig_us
        WHERE (h.started_at, h.rig_us) <> (excluded.started_at, excluded.rig_us)
          AND NOT hub.has_records(h.run, h.epoch);
    END IF;
    SELECT * INTO held FROM hub.stretch WHERE run = r.id AND epoch = (s ->> 'epoch')::bigint;
    IF (held.started_at, held.rig_us) <> (s ->> 'started_at', (s ->> 'rig_us')::bigint) THEN
        PERFORM hub.alert(j.bench, 'clash', r.id::text, 'the journal has another stretch: ' || s);
    END IF;
END $$;

-- As in step 11; with its seal, a run loses the stretches without a record. What another bench has shipped of it does not count.
CREATE OR REPLACE FUNCTION hub.take_end(j hub.journal, e json) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    r hub.run;
    shipped_seal bytea := decode(e ->> 'seal', 'hex');
BEGIN
    SELECT * INTO r FROM hub.run WHERE id = (e ->> 'run')::uuid AND bench = j.bench FOR UPDATE;
    IF NOT FOUND OR r.records > (e ->> 'records')::bigint THEN
        RETURN;
    END IF;
    IF r.records < (e ->> 'records')::bigint OR r.head <> decode(e ->> 'head', 'hex') THEN
        IF EXISTS (SELECT FROM hub.clash AS c WHERE c.run = r.id AND c.bench = j.bench) THEN
            PERFORM hub.alert(j.bench, 'clash', r.id::text, 'the journal has another end: ' || e);
            RETURN;
        END IF;
        RAISE EXCEPTION 'run % ended with % records, and the hub has %', r.id, e ->> 'records', r.records
            USING ERRCODE = 'HB002';
    END IF;
    IF r.seal IS NOT NULL THEN
        IF r.seal IS DISTINCT FROM shipped_seal THEN
            PERFORM hub.alert(j.bench, 'clash', r.id::text, 'the journal has another seal: ' || e);
        END IF;
        RETURN;
    END IF;
    IF shipped_seal IS NOT NULL
       AND shipped_seal IS DISTINCT FROM hub.run_seal(r.id, e ->> 'finished_at', e ->> 'status') THEN
        PERFORM hub.alert(j.bench, 'clash', r.id::text, 'the seal does not fit the records: ' || e);
        RETURN;
    END IF;
    UPDATE hub.run
    SET finished_at = e ->> 'finished_at', status = e ->> 'status', seal = shipped_seal,
        signature = decode(e ->> 'signature', 'hex')
    WHERE id = r.id;
    IF shipped_seal IS NOT NULL THEN
        DELETE FROM hub.stretch AS s WHERE s.run = r.id AND NOT hub.has_records(s.run, s.epoch);
    END IF;
END $$;

-- As in step 3; what a malformed record can cause is noted: values and texts, missing and doubled parts, and what is too large for an
-- index or too deep. A failure of the server is not, as without space: the batch is not taken, and comes again.
CREATE OR REPLACE FUNCTION hub.make_typed(of_run uuid, of_seq bigint, of_kind text, payload text, at timestamptz) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    r json;
    t json;
BEGIN
    -- PostgreSQL has no character 0.
    r := regexp_replace(payload, '(?<!\\)((?:\\\\)*)\\u0000', '\1\\ufffd', 'g')::json;
    CASE of_kind
    WHEN 'run_started' THEN
        INSERT INTO hub.run_fact VALUES (
            of_run, r ->> 'software', r #>> '{protocol,name}', r #>> '{rig,name}', (r ->> 'is_simulated')::boolean,
            (r #>> '{plan,touches}')::integer);
        INSERT INTO hub.sample
            SELECT of_run, s ->> 'name', (s ->> 'stiffness_mpa')::double precision
            FROM json_array_elements(r -> 'samples') AS s
            ON CONFLICT DO NOTHING;
    WHEN 'operator' THEN
        INSERT INTO hub.command VALUES (of_run, of_seq, at, r ->> 'who', r ->> 'action');
    WHEN 'touch_result', 'touch_refused' THEN
        t := r -> 'touch';
        INSERT INTO hub.touch VALUES (
            of_run, of_seq, at, t ->> 'step', t ->> 'phase', t ->> 'sample', t #>> '{pose,direction}',
            (t #>> '{pose,angle_deg}')::double precision, (t ->> 'repeat')::integer, r ->> 'reason',
            (r ->> 'no_load_hz')::double precision, (r ->> 'no_load_sigma_hz')::double precision,
            (r ->> 'resonance_hz')::double precision, (r ->> 'sigma_hz')::double precision,
            (r ->> 'shift_hz')::double precision, (r ->> 'shift_sigma_hz')::double precision,
            coalesce(r ->> 'surface_mm', r #>> '{indented,surface_mm}')::double precision,
            coalesce(r ->> 'indentation_mm', r #>> '{indented,indentation_mm}')::double precision);
    WHEN 'fault' THEN
        INSERT INTO hub.fault VALUES (of_run, of_seq, at, r ->> 'step', r ->> 'cause', r ->> 'probe');
    WHEN 'amended' THEN
        INSERT INTO hub.amendment VALUES (
            of_run, at, r ->> 'run', r ->> 'head', r ->> 'step', r ->> 'what', r ->> 'who', r ->> 'why');
    END CASE;
EXCEPTION WHEN data_exception OR not_null_violation OR unique_violation OR program_limit_exceeded THEN
    INSERT INTO hub.unread VALUES (of_run, of_seq, SQLERRM) ON CONFLICT DO NOTHING;
END $$;

-- As in step 6; a failure of the server is no fault of the record.
CREATE OR REPLACE FUNCTION hub.note_live() RETURNS trigger
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    of_run hub.run;
    r json;
BEGIN
    r := NEW.payload::json;
    SELECT * INTO of_run FROM hub.run WHERE id = NEW.run;
    INSERT INTO hub.live (bench) VALUES (of_run.bench) ON CONFLICT DO NOTHING;
    UPDATE hub.live AS l SET
        state = CASE
            WHEN NEW.kind = 'state_changed' THEN r ->> 'state'
            WHEN NEW.kind = 'run_finished' AND of_run.kind = 'session' THEN 'closed'
            ELSE l.state END,
        reason = CASE NEW.kind WHEN 'state_changed' THEN r ->> 'reason' ELSE l.reason END,
        run = CASE NEW.kind
            WHEN 'run_started' THEN NEW.run
            WHEN 'resumed' THEN NEW.run
            WHEN 'run_finished' THEN nullif(l.run, NEW.run)
            ELSE l.run END,
        waits = CASE NEW.kind
            WHEN 'prompt_asked' THEN hub.prompt_text(r -> 'prompt')
            WHEN 'refusal_asked' THEN 'decide about the touch ' || (r ->> 'step') || ': ' || (r ->> 'reason')
            WHEN 'state_changed' THEN l.waits
            ELSE NULL END,
        changed_at = now()
    WHERE l.bench = of_run.bench;
    RETURN NULL;
EXCEPTION WHEN data_exception OR program_limit_exceeded THEN
    INSERT INTO hub.unread VALUES (NEW.run, NEW.seq, SQLERRM) ON CONFLICT DO NOTHING;
    RETURN NULL;
END $$;

-- As in step 11; a record that another bench has shipped of the run is no gap of it.
CREATE OR REPLACE FUNCTION hub.take_record(j hub.journal, INOUT of_run hub.run, r json)
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    new_seq bigint := (r ->> 'seq')::bigint;
    new_epoch bigint := (r ->> 'epoch')::bigint;
    new_us bigint := (r ->> 'rig_us')::bigint;
    new_kind text := r ->> 'kind';
    new_payload text := r ->> 'payload';
    new_digest bytea := decode(r ->> 'digest', 'hex');
    is_taken_out boolean := hub.is_taken_out(new_kind, new_payload);
    held hub.record;
BEGIN
    IF of_run.bench <> j.bench THEN
        PERFORM hub.put_aside(j, 'the run is that of another bench', r);
        RETURN;
    END IF;
    IF new_seq <= of_run.records THEN
        IF of_run.pruned_at IS NOT NULL THEN
            IF new_seq = of_run.records AND new_digest <> of_run.head THEN
                PERFORM hub.put_aside(j, 'the records of the run were removed, and its last one was another', r);
            END IF;
            RETURN;
        END IF;
        SELECT * INTO held FROM hub.record AS h WHERE h.run = of_run.id AND h.seq = new_seq;
        IF FOUND AND held.digest <> new_digest THEN
            PERFORM hub.put_aside(j, 'the hub has another record at this place', r);
        ELSIF hub.is_taken_out(held.kind, held.payload) AND NOT is_taken_out THEN
            UPDATE hub.record AS h SET payload = new_payload
            WHERE h.run = of_run.id AND h.seq = new_seq
              AND h.kind = new_kind AND h.rig_us = new_us
              AND h.digest = hub.record_digest(hub.digest_before(of_run.id, h.seq), h.seq, h.rig_us, h.kind,
                                               new_payload);
        END IF;
        RETURN;
    END IF;
    IF new_seq > of_run.records + 1 THEN
        IF EXISTS (SELECT FROM hub.clash AS c WHERE c.run = of_run.id AND c.bench = j.bench AND c.seq = new_seq - 1) THEN
            PERFORM hub.put_aside(j, 'the record before it was put aside', r);
            RETURN;
        END IF;
        RAISE EXCEPTION 'run %: record % came, and the hub has %', of_run.id, new_seq, of_run.records
            USING ERRCODE = 'HB002';
    END IF;
    IF of_run.seal IS NOT NULL THEN
        PERFORM hub.put_aside(j, 'the run is sealed', r);
        RETURN;
    END IF;
    IF NOT is_taken_out AND new_digest <> hub.record_digest(of_run.head, new_seq, new_us, new_kind, new_payload) THEN
        PERFORM hub.put_aside(j, 'its digest does not follow from the record before it', r);
        RETURN;
    END IF;
    INSERT INTO hub.record VALUES (of_run.id, new_seq, new_epoch, new_us, new_kind, new_payload, new_digest,
                                   (r ->> 'event')::bigint);
    IF hub.is_typed(new_kind) THEN
        PERFORM hub.make_typed(of_run.id, new_seq, new_kind, new_payload,
                               hub.time_of(of_run.id, new_epoch, new_us));
    END IF;
    IF new_kind IN ('resumed', 'given_up') THEN
        UPDATE hub.run SET status = 'running', finished_at = NULL WHERE id = of_run.id
        RETURNING status, finished_at INTO of_run.status, of_run.finished_at;
    END IF;
    of_run.records := new_seq;
    of_run.head := new_digest;
END $$;

-- As in step 12; a record that another bench has shipped of a run does not keep it here.
CREATE OR REPLACE FUNCTION hub.must_stay(of_run hub.run) RETURNS text
LANGUAGE sql STABLE STRICT
RETURN CASE
    WHEN of_run.seal IS NULL THEN 'it has no seal'
    WHEN EXISTS (SELECT FROM hub.unread AS u WHERE u.run = of_run.id) THEN 'it has records without a typed row'
    WHEN EXISTS (SELECT FROM hub.clash AS c WHERE c.run = of_run.id AND c.bench = of_run.bench)
        THEN 'records of it were put aside'
    WHEN of_run.kind = 'run' AND NOT EXISTS (SELECT FROM hub.result AS r WHERE r.run = of_run.id)
        THEN 'it is not judged yet'
    WHEN of_run.kind = 'run'
         AND (SELECT r.amendments FROM hub.result AS r WHERE r.run = of_run.id) <> hub.amendments(of_run)
        THEN 'it was amended, and is not judged again yet'
    WHEN EXISTS (SELECT FROM hub.run AS r WHERE r.id = hub.amended_run(of_run) AND r.pruned_at IS NULL)
        THEN 'the run that it amends stays'
END;
