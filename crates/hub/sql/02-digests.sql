-- The digests of docs/data.md, computed by PostgreSQL.

-- A text behind its length in bytes, as it enters a digest.
CREATE FUNCTION hub.text_part(part text) RETURNS bytea
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
RETURN int8send(octet_length(convert_to(part, 'UTF8'))) || convert_to(part, 'UTF8');

-- The digest of a record behind one with the digest `before`.
CREATE FUNCTION hub.record_digest(before bytea, seq bigint, rig_us bigint, kind text, payload text) RETURNS bytea
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
RETURN sha256(before || int8send(seq) || int8send(rig_us) || hub.text_part(kind) || hub.text_part(payload));

-- The seal of a run that ended so, over the records that are here.
CREATE FUNCTION hub.run_seal(run uuid, finished_at text, status text) RETURNS bytea
LANGUAGE sql STABLE STRICT
RETURN (
    SELECT sha256(
        hub.text_part(r.origin_bench) || hub.text_part(r.origin_journal) || hub.text_part(r.id::text)
        || hub.text_part(r.kind) || hub.text_part(r.name) || int8send(r.format) || int8send(r.epoch)
        || hub.text_part(r.started_at)
        || coalesce((
            SELECT string_agg(int8send(s.epoch) || hub.text_part(s.started_at) || int8send(s.rig_us), ''::bytea
                              ORDER BY s.epoch)
            FROM hub.stretch AS s WHERE s.run = r.id), ''::bytea)
        || hub.text_part(run_seal.finished_at) || hub.text_part(run_seal.status) || int8send(r.records) || r.head)
    FROM hub.run AS r WHERE r.id = run_seal.run
);

-- Whether an archive took the content of a record of this kind out of the journal; its digest stayed.
CREATE FUNCTION hub.is_taken_out(kind text, payload text) RETURNS boolean
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
RETURN payload = '' AND kind IN ('sweep', 'descended', 'surface_found', 'surface_not_found', 'surface_checked',
                                 'black_box');

-- The first id of a run that began in this month: the first 48 bits of a UUID of version 7 are its time in ms.
CREATE FUNCTION hub.first_id(month timestamp) RETURNS uuid
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
RETURN rpad(lpad(to_hex((extract(epoch FROM month) * 1000)::bigint), 12, '0'), 32, '0')::uuid;

-- Makes the partition for the records of a run. Runs whose id has no time between 2020 and 2100 are in the default one.
CREATE FUNCTION hub.make_partition(run uuid) RETURNS void
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    month timestamp := date_trunc('month', to_timestamp(
        ('x' || left(replace(run::text, '-', ''), 12))::bit(48)::bigint / 1000) AT TIME ZONE 'UTC');
    partition text := to_char(month, '"record_"YYYY_MM');
BEGIN
    IF substr(run::text, 15, 1) <> '7' OR month < '2020-01-01' OR month >= '2100-01-01'
       OR to_regclass('hub.' || partition) IS NOT NULL THEN
        RETURN;
    END IF;
    -- One maker at a time; another one may have made it meanwhile.
    PERFORM pg_advisory_xact_lock(hashtextextended('partitions of hub.record', 0));
    EXECUTE format('CREATE TABLE IF NOT EXISTS hub.%I PARTITION OF hub.record FOR VALUES FROM (%L) TO (%L)',
                   partition, hub.first_id(month), hub.first_id(month + interval '1 month'));
END $$;
