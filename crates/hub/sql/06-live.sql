-- What each rig does now, as its records say it while they come.

CREATE TABLE hub.live (
    bench bigint PRIMARY KEY REFERENCES hub.bench,
    state text,
    reason text,
    run uuid REFERENCES hub.run,
    -- What a person is asked to do, until it is answered.
    waits text,
    changed_at timestamptz NOT NULL DEFAULT now()
);

-- A prompt as a person reads it.
CREATE FUNCTION hub.prompt_text(prompt json) RETURNS text
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
RETURN CASE prompt ->> 'what'
    WHEN 'place_sample' THEN 'place sample ' || (prompt ->> 'sample')
    WHEN 'turn_sensor' THEN 'turn the sensor to ' || (prompt ->> 'orientation')
    ELSE prompt::text
END;

CREATE FUNCTION hub.note_live() RETURNS trigger
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
EXCEPTION WHEN others THEN
    INSERT INTO hub.unread VALUES (NEW.run, NEW.seq, SQLERRM) ON CONFLICT DO NOTHING;
    RETURN NULL;
END $$;

CREATE TRIGGER live AFTER INSERT ON hub.record FOR EACH ROW
WHEN (NEW.kind IN ('state_changed', 'run_started', 'resumed', 'run_finished', 'prompt_asked', 'prompt_answered',
                   'refusal_asked', 'refusal_answered'))
EXECUTE FUNCTION hub.note_live();

REVOKE ALL ON FUNCTION hub.prompt_text(json), hub.note_live() FROM PUBLIC;
GRANT SELECT ON hub.live TO rigd_hub_reader;
