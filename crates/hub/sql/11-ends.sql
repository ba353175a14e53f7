-- Runs that go on behind an end, seals of ends that are not complete, and the amendments of a run.

-- The results of runs look for them by the run that they amend.
CREATE INDEX ON hub.run (name) WHERE kind = 'amendment';
-- How many amendments a result has. Times do not tell: one may have begun to come before the result, and be there after it.
ALTER TABLE hub.result ADD COLUMN amendments bigint NOT NULL DEFAULT 0;

-- As in step 8; a run that was amended since it was judged stays.
CREATE OR REPLACE FUNCTION hub.must_stay(of_run hub.run) RETURNS text
LANGUAGE sql STABLE STRICT
RETURN CASE
    WHEN of_run.seal IS NULL THEN 'it has no seal'
    WHEN EXISTS (SELECT FROM hub.unread AS u WHERE u.run = of_run.id) THEN 'it has records without a typed row'
    WHEN EXISTS (SELECT FROM hub.clash AS c WHERE c.run = of_run.id) THEN 'records of it were put aside'
    WHEN of_run.kind = 'run' AND NOT EXISTS (SELECT FROM hub.result AS r WHERE r.run = of_run.id)
        THEN 'it is not judged yet'
    WHEN of_run.kind = 'run' AND (SELECT r.amendments FROM hub.result AS r WHERE r.run = of_run.id) <> (
        SELECT count(*) FROM hub.run AS a
        WHERE a.kind = 'amendment' AND a.name = of_run.id::text AND a.seal IS NOT NULL)
        THEN 'it was amended, and is not judged again yet'
END;

-- As in step 8; a run that is resumed or given up is running again, as at its beginning.
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
    IF new_kind IN ('resumed', 'given_up') THEN
        UPDATE hub.run SET status = 'running', finished_at = NULL WHERE id = of_run.id
        RETURNING status, finished_at INTO of_run.status, of_run.finished_at;
    END IF;
    of_run.records := new_seq;
    of_run.head := new_digest;
END $$;

-- As in step 4; without a time and a status of the end, no seal fits.
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
    IF shipped_seal IS NOT NULL
       AND shipped_seal IS DISTINCT FROM hub.run_seal(r.id, e ->> 'finished_at', e ->> 'status') THEN
        PERFORM hub.alert(j.bench, 'clash', r.id::text, 'the seal does not fit the records: ' || e);
        RETURN;
    END IF;
    UPDATE hub.run
    SET finished_at = e ->> 'finished_at', status = e ->> 'status', seal = shipped_seal,
        signature = decode(e ->> 'signature', 'hex')
    WHERE id = r.id;
END $$;

-- The runs that have gone on and kept their last end.
UPDATE hub.run AS r SET status = 'running', finished_at = NULL
WHERE r.seal IS NULL AND r.finished_at IS NOT NULL
  AND (SELECT l.kind FROM hub.record AS l WHERE l.run = r.id AND l.seq = r.records) <> 'run_finished';
