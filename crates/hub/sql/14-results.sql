-- What a second reader of the hub found (decision 198).

-- As in step 13; results that could not be made are none.
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
         AND (SELECT r.reason FROM hub.result AS r WHERE r.run = of_run.id) IS NOT NULL
        THEN 'its results could not be made'
    WHEN of_run.kind = 'run'
         AND (SELECT r.amendments FROM hub.result AS r WHERE r.run = of_run.id) <> hub.amendments(of_run)
        THEN 'it was amended, and is not judged again yet'
    WHEN EXISTS (SELECT FROM hub.run AS r WHERE r.id = hub.amended_run(of_run) AND r.pruned_at IS NULL)
        THEN 'the run that it amends stays'
END;

-- As in step 13; the end of a session is the end of what was under way in it.
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
        run = CASE
            WHEN NEW.kind IN ('run_started', 'resumed') THEN NEW.run
            WHEN NEW.kind = 'run_finished' AND of_run.kind = 'session' THEN NULL
            WHEN NEW.kind = 'run_finished' THEN nullif(l.run, NEW.run)
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
