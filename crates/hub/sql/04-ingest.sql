-- How a bench ships. Its role can call greet(), ingest() and rewind(), and nothing else writes.
--
--   greet(journal)   ──▶ cursor ──▶ ingest(journal, cursor, batch) ──▶ cursor ──▶ …
--                          └─ the journal has another record there ──▶ rewind(journal, cursor) ──▶ cursor 0
--
-- Errors of class HB: HB001 the journal is quarantined, HB002 something is missing, HB003 the journal differs at the
-- cursor, HB004 the batch is not as it must be.

-- The last event of a journal that is here, and the digest of its record in hexadecimal; or why the hub takes nothing.
CREATE TYPE hub.cursor AS (event bigint, digest text, refusal text);

-- The bench whose role opened this connection; NULL for another role.
CREATE FUNCTION hub.own_bench() RETURNS bigint
LANGUAGE sql STABLE SECURITY DEFINER SET search_path = pg_catalog, pg_temp
BEGIN ATOMIC
    SELECT id FROM hub.bench WHERE role = session_user;
END;

-- Notes what an administrator must look at, and tells those who listen.
CREATE FUNCTION hub.alert(of_bench bigint, of_kind text, about text, what text) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    is_new boolean;
BEGIN
    INSERT INTO hub.alarm (bench, kind, subject, detail) VALUES (of_bench, of_kind, about, what)
    ON CONFLICT (kind, subject, coalesce(bench, 0)) WHERE acknowledged_at IS NULL
    DO UPDATE SET times = alarm.times + 1, last_at = now(), detail = excluded.detail
    RETURNING times = 1 INTO is_new;
    IF is_new THEN
        PERFORM pg_notify('rigd_hub_alarm', of_kind || ' ' || about);
        RAISE WARNING 'rigd-hub: %: %: %', of_kind, about, what;
    END IF;
END $$;

-- The journal with this id, locked, if it is one of the bench that calls.
CREATE FUNCTION hub.own_journal(wanted uuid) RETURNS hub.journal
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    found_journal hub.journal;
BEGIN
    SELECT * INTO found_journal FROM hub.journal WHERE id = wanted AND bench = hub.own_bench() FOR UPDATE;
    IF NOT FOUND THEN
        RAISE EXCEPTION 'journal % is not one of role %', wanted, session_user
            USING ERRCODE = 'insufficient_privilege', HINT = 'call hub.greet() first';
    END IF;
    RETURN found_journal;
END $$;

-- Begins to ship a journal, or goes on: the answer is where.
CREATE FUNCTION hub.greet(wanted uuid, of_software text) RETURNS hub.cursor
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    own bigint := hub.own_bench();
    j hub.journal;
BEGIN
    IF own IS NULL THEN
        RAISE EXCEPTION 'role % is not that of a bench', session_user USING ERRCODE = 'insufficient_privilege';
    END IF;
    INSERT INTO hub.journal (id, bench, software) VALUES (wanted, own, of_software) ON CONFLICT DO NOTHING;
    SELECT * INTO j FROM hub.journal WHERE id = wanted FOR UPDATE;
    IF j.bench <> own THEN
        PERFORM hub.alert(own, 'stranger', wanted::text, format(
            'role %s ships a journal of %s', session_user, (SELECT role FROM hub.bench WHERE id = j.bench)));
        RETURN ROW(NULL, NULL, 'the journal is that of another bench')::hub.cursor;
    END IF;
    UPDATE hub.journal SET last_seen = now(), software = of_software WHERE id = wanted;
    RETURN ROW(j.cursor_event, encode(j.cursor_digest, 'hex'), j.quarantined)::hub.cursor;
END $$;

-- Begins a journal again that has another record at the cursor: it was restored from a backup, or is one of two copies.
-- Everything is sent again; what is here already is not taken twice.
CREATE FUNCTION hub.rewind(wanted uuid, from_event bigint) RETURNS hub.cursor
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    j hub.journal := hub.own_journal(wanted);
BEGIN
    IF j.quarantined IS NULL AND j.cursor_event = from_event AND from_event > 0 THEN
        INSERT INTO hub.left_line (journal, event, digest) VALUES (wanted, j.cursor_event, j.cursor_digest)
        ON CONFLICT DO NOTHING;
        UPDATE hub.journal SET cursor_event = 0, cursor_digest = '', rewinds = rewinds + 1 WHERE id = wanted
        RETURNING * INTO j;
        PERFORM hub.alert(j.bench, 'rewound', wanted::text, format(
            'the journal had another record at event %s, and is sent again from its beginning', from_event));
    END IF;
    RETURN ROW(j.cursor_event, encode(j.cursor_digest, 'hex'), j.quarantined)::hub.cursor;
END $$;

-- Puts a record aside that is not taken.
CREATE FUNCTION hub.put_aside(j hub.journal, why text, r json) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
BEGIN
    INSERT INTO hub.clash (bench, journal, reason, run, seq, epoch, rig_us, kind, payload, digest, event)
    VALUES (j.bench, j.id, why, (r ->> 'run')::uuid, (r ->> 'seq')::bigint, (r ->> 'epoch')::bigint,
            (r ->> 'rig_us')::bigint, r ->> 'kind', r ->> 'payload', decode(r ->> 'digest', 'hex'),
            (r ->> 'event')::bigint)
    ON CONFLICT DO NOTHING;
    IF FOUND THEN
        PERFORM hub.alert(j.bench, 'clash', r ->> 'run', format('record %s was put aside: %s', r ->> 'seq', why));
    END IF;
END $$;

-- Takes one record of a run. The answer is the run with it.
CREATE FUNCTION hub.take_record(j hub.journal, INOUT of_run hub.run, r json)
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
        IF EXISTS (SELECT FROM hub.clash AS c WHERE c.run = of_run.id AND c.seq = new_seq - 1) THEN
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
    of_run.records := new_seq;
    of_run.head := new_digest;
END $$;

-- The digest of the record before this one; zeros before the first.
CREATE FUNCTION hub.digest_before(of_run uuid, of_seq bigint) RETURNS bytea
LANGUAGE sql STABLE STRICT
RETURN coalesce((SELECT r.digest FROM hub.record AS r WHERE r.run = of_run AND r.seq = of_seq - 1),
                decode(repeat('00', 32), 'hex'));

-- Takes the entry of a run in the list of runs of the journal.
CREATE FUNCTION hub.take_entry(j hub.journal, e json) RETURNS void
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
    SELECT * INTO held FROM hub.run WHERE id = wanted FOR UPDATE;
    IF held.bench <> j.bench THEN
        PERFORM hub.alert(j.bench, 'stranger', wanted::text, 'a run of another bench was shipped');
    ELSIF (held.origin_bench, held.origin_journal, held.kind, held.name, held.format, held.epoch, held.started_at)
          <> (e ->> 'bench', e ->> 'journal', e ->> 'kind', e ->> 'name', (e ->> 'format')::bigint,
              (e ->> 'epoch')::bigint, e ->> 'started_at') THEN
        PERFORM hub.alert(j.bench, 'clash', wanted::text, 'the list of runs of the journal has another entry: ' || e);
    END IF;
END $$;

-- Takes the beginning of a part of a run on one clock.
CREATE FUNCTION hub.take_stretch(j hub.journal, s json) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    wanted uuid := (s ->> 'run')::uuid;
    held hub.stretch;
BEGIN
    INSERT INTO hub.stretch
    SELECT wanted, (s ->> 'epoch')::bigint, s ->> 'started_at', (s ->> 'rig_us')::bigint
    FROM hub.run AS r WHERE r.id = wanted AND r.bench = j.bench AND r.seal IS NULL
    ON CONFLICT DO NOTHING;
    SELECT * INTO held FROM hub.stretch WHERE run = wanted AND epoch = (s ->> 'epoch')::bigint;
    IF (held.started_at, held.rig_us) <> (s ->> 'started_at', (s ->> 'rig_us')::bigint) THEN
        PERFORM hub.alert(j.bench, 'clash', wanted::text, 'the journal has another stretch: ' || s);
    END IF;
END $$;

-- Takes the end of a run whose last record is in the batch.
CREATE FUNCTION hub.take_end(j hub.journal, e json) RETURNS void
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
        IF EXISTS (SELECT FROM hub.clash AS c WHERE c.run = r.id) THEN
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
    IF shipped_seal <> hub.run_seal(r.id, e ->> 'finished_at', e ->> 'status') THEN
        PERFORM hub.alert(j.bench, 'clash', r.id::text, 'the seal does not fit the records: ' || e);
        RETURN;
    END IF;
    UPDATE hub.run
    SET finished_at = e ->> 'finished_at', status = e ->> 'status', seal = shipped_seal,
        signature = decode(e ->> 'signature', 'hex')
    WHERE id = r.id;
END $$;

-- Takes records behind an event of a journal, in the order of their events, with entries, stretches and ends of their
-- runs. All of them are committed with the cursor that is the answer, or none.
CREATE FUNCTION hub.ingest(journal uuid, after_event bigint, batch json) RETURNS hub.cursor
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
            UPDATE hub.run SET records = of_run.records, head = of_run.head WHERE id = of_run.id;
            SELECT * INTO of_run FROM hub.run WHERE id = (r ->> 'run')::uuid FOR UPDATE;
            IF NOT FOUND THEN
                RAISE EXCEPTION 'run % has no entry', r ->> 'run' USING ERRCODE = 'HB004';
            END IF;
        END IF;
        of_run := hub.take_record(j, of_run, r);
    END LOOP;
    UPDATE hub.run SET records = of_run.records, head = of_run.head WHERE id = of_run.id;
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
