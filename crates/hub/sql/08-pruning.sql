-- Removes the records of runs that are in verified objects. What is typed, the list of runs and the seals stay.

-- Objects that were read, and are their run.
CREATE TABLE hub.object (
    run uuid PRIMARY KEY REFERENCES hub.run,
    name text NOT NULL,
    verified_at timestamptz NOT NULL DEFAULT now()
);
ALTER TABLE hub.run ADD COLUMN pruned_at timestamptz;
-- Each call of `rigd-hub prune`.
CREATE TABLE hub.pruning (
    at timestamptz PRIMARY KEY DEFAULT now(),
    keep_days integer NOT NULL,
    objects text NOT NULL,
    runs bigint NOT NULL,
    records bigint NOT NULL,
    -- Runs that were old enough, and stayed.
    stayed bigint NOT NULL
);

-- When the hub took the last record of a run; NULL without one. The clock is that of the hub.
CREATE FUNCTION hub.taken_at(of_run hub.run) RETURNS timestamptz
LANGUAGE sql STABLE STRICT
RETURN (SELECT r.received_at FROM hub.record AS r WHERE r.run = of_run.id AND r.seq = of_run.records);

-- Why a run that is old enough must stay; NULL if only its object is asked for.
CREATE FUNCTION hub.must_stay(of_run hub.run) RETURNS text
LANGUAGE sql STABLE STRICT
RETURN CASE
    WHEN of_run.seal IS NULL THEN 'it has no seal'
    WHEN EXISTS (SELECT FROM hub.unread AS u WHERE u.run = of_run.id) THEN 'it has records without a typed row'
    WHEN EXISTS (SELECT FROM hub.clash AS c WHERE c.run = of_run.id) THEN 'records of it were put aside'
    WHEN of_run.kind = 'run' AND NOT EXISTS (SELECT FROM hub.result AS r WHERE r.run = of_run.id)
        THEN 'it is not judged yet'
END;

-- Removes the records of a run whose object has this seal, and returns how many.
CREATE FUNCTION hub.prune_run(wanted uuid, object_name text, object_seal bytea, keep interval) RETURNS bigint
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    r hub.run;
    removed bigint;
BEGIN
    SELECT * INTO r FROM hub.run WHERE id = wanted FOR UPDATE;
    IF r.pruned_at IS NOT NULL OR r.seal IS DISTINCT FROM object_seal OR hub.must_stay(r) IS NOT NULL
       OR coalesce(hub.taken_at(r) > now() - keep, true) THEN
        RETURN 0;
    END IF;
    DELETE FROM hub.record WHERE run = wanted;
    GET DIAGNOSTICS removed = ROW_COUNT;
    INSERT INTO hub.object (run, name) VALUES (wanted, object_name)
    ON CONFLICT (run) DO UPDATE SET name = excluded.name, verified_at = now();
    UPDATE hub.run SET pruned_at = now() WHERE id = wanted;
    RETURN removed;
END $$;

-- Drops the partitions of months that are over and have no records any more.
CREATE FUNCTION hub.drop_empty_partitions() RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    partition text;
    has_records boolean;
BEGIN
    FOR partition IN
        SELECT c.relname FROM pg_inherits AS i JOIN pg_class AS c ON c.oid = i.inhrelid
        WHERE i.inhparent = 'hub.record'::regclass AND c.relname ~ '^record_\d{4}_\d{2}$'
          AND c.relname < to_char(now() AT TIME ZONE 'UTC', '"record_"YYYY_MM')
    LOOP
        EXECUTE format('LOCK TABLE hub.%I IN ACCESS EXCLUSIVE MODE', partition);
        EXECUTE format('SELECT EXISTS (SELECT FROM hub.%I)', partition) INTO has_records;
        IF NOT has_records THEN
            EXECUTE format('DROP TABLE hub.%I', partition);
        END IF;
    END LOOP;
END $$;

-- As in step 4; of a run whose records were removed, the last one is compared with the head.
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

REVOKE ALL ON FUNCTION hub.taken_at(hub.run), hub.must_stay(hub.run),
    hub.prune_run(uuid, text, bytea, interval), hub.drop_empty_partitions() FROM PUBLIC;
GRANT SELECT ON hub.object, hub.pruning TO rigd_hub_reader;
