-- What the report of a run finds, made of its records by `rigd-hub judge`. SQL cannot make it again.

CREATE TABLE hub.result (
    run uuid PRIMARY KEY REFERENCES hub.run,
    -- `holds`, `strained` or `rejected`; NULL if the touches cannot say.
    model_verdict text,
    -- Why there are no results; NULL if there are some.
    reason text,
    judged_at timestamptz NOT NULL DEFAULT now()
);
CREATE INDEX ON hub.result (model_verdict);
-- The stiffness of each sample, with the angle compensated, and its standard deviation.
CREATE TABLE hub.stiffness (
    run uuid NOT NULL REFERENCES hub.result,
    sample text NOT NULL,
    stiffness_mpa double precision NOT NULL,
    sigma_mpa double precision,
    known_mpa double precision,
    PRIMARY KEY (run, sample)
);
CREATE INDEX ON hub.stiffness (sample);

GRANT SELECT ON hub.result, hub.stiffness TO rigd_hub_reader;
