-- Tables with types, made of records and nothing else: hub.rebuild() makes them again.

CREATE TABLE hub.run_fact (
    run uuid PRIMARY KEY REFERENCES hub.run,
    software text NOT NULL,
    protocol text NOT NULL,
    rig text NOT NULL,
    is_simulated boolean NOT NULL,
    touches integer NOT NULL
);
CREATE TABLE hub.sample (
    run uuid NOT NULL REFERENCES hub.run,
    name text NOT NULL,
    known_mpa double precision,
    PRIMARY KEY (run, name)
);
CREATE INDEX ON hub.sample (name);
CREATE TABLE hub.command (
    run uuid NOT NULL REFERENCES hub.run,
    seq bigint NOT NULL,
    at timestamptz,
    who text NOT NULL,
    action text NOT NULL,
    PRIMARY KEY (run, seq)
);
CREATE INDEX ON hub.command (who);
-- A refused touch has a reason, and no resonance and shift.
CREATE TABLE hub.touch (
    run uuid NOT NULL REFERENCES hub.run,
    seq bigint NOT NULL,
    at timestamptz,
    step text NOT NULL,
    phase text NOT NULL,
    sample text NOT NULL,
    direction text NOT NULL,
    angle_deg double precision NOT NULL,
    repeat integer NOT NULL,
    reason text,
    no_load_hz double precision NOT NULL,
    no_load_sigma_hz double precision NOT NULL,
    resonance_hz double precision,
    sigma_hz double precision,
    shift_hz double precision,
    shift_sigma_hz double precision,
    surface_mm double precision,
    indentation_mm double precision,
    PRIMARY KEY (run, seq)
);
CREATE INDEX ON hub.touch (sample);
CREATE TABLE hub.fault (
    run uuid NOT NULL REFERENCES hub.run,
    seq bigint NOT NULL,
    at timestamptz,
    step text,
    cause text NOT NULL,
    probe text NOT NULL,
    PRIMARY KEY (run, seq)
);
CREATE TABLE hub.amendment (
    run uuid PRIMARY KEY REFERENCES hub.run,
    at timestamptz,
    amended_run text NOT NULL,
    amended_head text NOT NULL,
    step text NOT NULL,
    what text NOT NULL,
    who text NOT NULL,
    why text NOT NULL
);
CREATE INDEX ON hub.amendment (amended_run);
-- Records of a known kind that could not be read, as of another format. They are in hub.record as they came.
CREATE TABLE hub.unread (
    run uuid NOT NULL REFERENCES hub.run,
    seq bigint NOT NULL,
    reason text NOT NULL,
    PRIMARY KEY (run, seq)
);

-- The kinds of records with a row in these tables.
CREATE FUNCTION hub.is_typed(kind text) RETURNS boolean
LANGUAGE sql IMMUTABLE STRICT PARALLEL SAFE
RETURN kind IN ('run_started', 'operator', 'touch_result', 'touch_refused', 'fault', 'amended');

-- When a record was made: the beginning of its stretch, and from there on by the rig's clock.
CREATE FUNCTION hub.time_of(of_run uuid, of_epoch bigint, rig_us bigint) RETURNS timestamptz
LANGUAGE sql STABLE STRICT
RETURN (
    SELECT s.started_at::timestamptz + (time_of.rig_us - s.rig_us) * interval '1 microsecond'
    FROM hub.stretch AS s WHERE s.run = of_run AND s.epoch = of_epoch
);

-- Makes the row of a record. A record that cannot be read is noted, and stops nothing.
CREATE FUNCTION hub.make_typed(of_run uuid, of_seq bigint, of_kind text, payload text, at timestamptz) RETURNS void
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
EXCEPTION WHEN others THEN
    INSERT INTO hub.unread VALUES (of_run, of_seq, SQLERRM) ON CONFLICT DO NOTHING;
END $$;

-- Makes the rows of all runs again whose records are here; runs whose records were removed keep theirs. It holds up
-- ingest() meanwhile.
CREATE FUNCTION hub.rebuild() RETURNS bigint
LANGUAGE plpgsql SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    typed text;
    made bigint;
BEGIN
    LOCK TABLE hub.journal IN EXCLUSIVE MODE;
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
