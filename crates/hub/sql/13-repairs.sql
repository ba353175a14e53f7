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

REVOKE ALL ON FUNCTION hub.month_of(uuid) FROM PUBLIC;
