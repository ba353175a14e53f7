-- What benches have shipped, as their journals have it. docs/hub.md describes the tables.

-- A bench ships by a role of its own. The name of the role is LAB/NAME.
CREATE TABLE hub.bench (
    id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    lab text NOT NULL,
    name text NOT NULL,
    role name NOT NULL UNIQUE,
    added_at timestamptz NOT NULL DEFAULT now(),
    UNIQUE (lab, name)
);

-- `cursor_event` is the last event of the journal that is committed here, and `cursor_digest` the digest of its record.
CREATE TABLE hub.journal (
    id uuid PRIMARY KEY,
    bench bigint NOT NULL REFERENCES hub.bench,
    software text NOT NULL,
    cursor_event bigint NOT NULL DEFAULT 0,
    cursor_digest bytea NOT NULL DEFAULT '',
    rewinds integer NOT NULL DEFAULT 0,
    quarantined text,
    first_seen timestamptz NOT NULL DEFAULT now(),
    last_seen timestamptz NOT NULL DEFAULT now()
);

-- The cursors at which a journal was found to differ, and was sent again from its beginning.
CREATE TABLE hub.left_line (
    journal uuid NOT NULL REFERENCES hub.journal,
    event bigint NOT NULL,
    digest bytea NOT NULL,
    left_at timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (journal, event, digest)
);

-- From `origin_bench` to `started_at`, and `finished_at`, `status` and `seal`: the list of runs of the journal.
-- `records` and `head` are what is here.
CREATE TABLE hub.run (
    id uuid PRIMARY KEY,
    bench bigint NOT NULL REFERENCES hub.bench,
    journal uuid NOT NULL REFERENCES hub.journal,
    origin_bench text NOT NULL,
    origin_journal text NOT NULL,
    kind text NOT NULL,
    name text NOT NULL,
    format bigint NOT NULL,
    epoch bigint NOT NULL,
    started_at text NOT NULL,
    finished_at text,
    status text NOT NULL DEFAULT 'running',
    seal bytea,
    signature bytea,
    records bigint NOT NULL DEFAULT 0,
    head bytea NOT NULL DEFAULT decode(repeat('00', 32), 'hex'),
    received_at timestamptz NOT NULL DEFAULT now()
);
CREATE INDEX ON hub.run (started_at DESC);
CREATE INDEX ON hub.run (bench, started_at DESC);

CREATE TABLE hub.stretch (
    run uuid NOT NULL REFERENCES hub.run,
    epoch bigint NOT NULL,
    started_at text NOT NULL,
    rig_us bigint NOT NULL,
    PRIMARY KEY (run, epoch)
);

-- The payload is text: jsonb would not keep its bytes. The digest is not the key: two runs with one seed have the same
-- digests. A partition is a month of runs, so that old records go with their partition.
CREATE TABLE hub.record (
    run uuid NOT NULL,
    seq bigint NOT NULL,
    epoch bigint NOT NULL,
    rig_us bigint NOT NULL,
    kind text NOT NULL,
    payload text NOT NULL,
    digest bytea NOT NULL,
    event bigint NOT NULL,
    received_at timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (run, seq)
) PARTITION BY RANGE (run);
CREATE TABLE hub.record_other PARTITION OF hub.record DEFAULT;

-- What came and was not taken: a record that differs from the one here, or does not fit behind it. Nothing is lost.
CREATE TABLE hub.clash (
    id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    bench bigint NOT NULL REFERENCES hub.bench,
    journal uuid NOT NULL REFERENCES hub.journal,
    reason text NOT NULL,
    run uuid NOT NULL,
    seq bigint NOT NULL,
    epoch bigint NOT NULL,
    rig_us bigint NOT NULL,
    kind text NOT NULL,
    payload text NOT NULL,
    digest bytea NOT NULL,
    event bigint NOT NULL,
    received_at timestamptz NOT NULL DEFAULT now(),
    UNIQUE (bench, run, seq, kind, digest)
);

-- What an administrator must look at. One row for each cause, until it is acknowledged.
CREATE TABLE hub.alarm (
    id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    bench bigint REFERENCES hub.bench,
    kind text NOT NULL,
    subject text NOT NULL,
    detail text NOT NULL,
    times bigint NOT NULL DEFAULT 1,
    first_at timestamptz NOT NULL DEFAULT now(),
    last_at timestamptz NOT NULL DEFAULT now(),
    acknowledged_at timestamptz,
    acknowledged_by text
);
CREATE UNIQUE INDEX ON hub.alarm (kind, subject, coalesce(bench, 0)) WHERE acknowledged_at IS NULL;
