-- Live messages by NATS: the server, and the viewers of each laboratory.

CREATE TABLE hub.live_server (
    is_only boolean PRIMARY KEY DEFAULT true CHECK (is_only),
    host text NOT NULL,
    port integer NOT NULL,
    -- Directory of the authority, on the computer of the hub.
    certificates text NOT NULL
);

CREATE TABLE hub.viewer (
    lab text NOT NULL,
    name text NOT NULL,
    PRIMARY KEY (lab, name)
);

GRANT SELECT ON hub.live_server, hub.viewer TO rigd_hub_reader;
