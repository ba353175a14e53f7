-- What an amendment means for the records and the results of its run. Benches amend their own runs only.

-- How many amendments of a run have ended.
CREATE FUNCTION hub.amendments(of_run hub.run) RETURNS bigint
LANGUAGE sql STABLE STRICT
RETURN (SELECT count(*) FROM hub.run AS a
        WHERE a.kind = 'amendment' AND a.name = of_run.id::text AND a.bench = of_run.bench AND a.seal IS NOT NULL);

-- The run that this one amends, if the hub has it.
CREATE FUNCTION hub.amended_run(amendment hub.run) RETURNS uuid
LANGUAGE sql STABLE STRICT
RETURN (SELECT r.id FROM hub.run AS r
        WHERE amendment.kind = 'amendment' AND r.bench = amendment.bench
          AND r.id = CASE WHEN amendment.name ~ '^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$' THEN amendment.name::uuid END);

-- As in step 11; the records of an amendment stay as long as those of its run, whose results need both.
CREATE OR REPLACE FUNCTION hub.must_stay(of_run hub.run) RETURNS text
LANGUAGE sql STABLE STRICT
RETURN CASE
    WHEN of_run.seal IS NULL THEN 'it has no seal'
    WHEN EXISTS (SELECT FROM hub.unread AS u WHERE u.run = of_run.id) THEN 'it has records without a typed row'
    WHEN EXISTS (SELECT FROM hub.clash AS c WHERE c.run = of_run.id) THEN 'records of it were put aside'
    WHEN of_run.kind = 'run' AND NOT EXISTS (SELECT FROM hub.result AS r WHERE r.run = of_run.id)
        THEN 'it is not judged yet'
    WHEN of_run.kind = 'run'
         AND (SELECT r.amendments FROM hub.result AS r WHERE r.run = of_run.id) <> hub.amendments(of_run)
        THEN 'it was amended, and is not judged again yet'
    WHEN EXISTS (SELECT FROM hub.run AS r WHERE r.id = hub.amended_run(of_run) AND r.pruned_at IS NULL)
        THEN 'the run that it amends stays'
END;

-- Results that cannot be made again are withdrawn when their run is amended.
CREATE FUNCTION hub.withdraw_results() RETURNS trigger
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    r hub.run;
BEGIN
    -- Locked, so that it is not pruned in the meantime.
    SELECT * INTO r FROM hub.run WHERE id = hub.amended_run(NEW) FOR UPDATE;
    IF r.pruned_at IS NULL THEN
        RETURN NULL;
    END IF;
    DELETE FROM hub.stiffness WHERE run = r.id;
    UPDATE hub.result
    SET model_verdict = NULL, reason = 'it was amended after its records were removed',
        amendments = hub.amendments(r), judged_at = now()
    WHERE run = r.id;
    PERFORM hub.alert(NEW.bench, 'amended', r.id::text,
                      'the run was amended after its records were removed, and its results are withdrawn');
    RETURN NULL;
END $$;
CREATE TRIGGER withdraw_results AFTER UPDATE OF seal ON hub.run
FOR EACH ROW WHEN (NEW.kind = 'amendment' AND OLD.seal IS NULL AND NEW.seal IS NOT NULL)
EXECUTE FUNCTION hub.withdraw_results();

REVOKE ALL ON FUNCTION hub.amendments(hub.run), hub.amended_run(hub.run), hub.withdraw_results() FROM PUBLIC;
