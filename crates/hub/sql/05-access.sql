-- Who may do what. A bench sees what it has shipped, and writes by three functions. A reader sees everything.

REVOKE ALL ON ALL FUNCTIONS IN SCHEMA hub FROM PUBLIC;
GRANT USAGE ON SCHEMA hub TO rigd_hub_bench, rigd_hub_reader;

GRANT EXECUTE ON FUNCTION hub.own_bench() TO rigd_hub_bench;
GRANT EXECUTE ON FUNCTION hub.greet(uuid, text) TO rigd_hub_bench;
GRANT EXECUTE ON FUNCTION hub.ingest(uuid, bigint, json) TO rigd_hub_bench;
GRANT EXECUTE ON FUNCTION hub.rewind(uuid, bigint) TO rigd_hub_bench;

GRANT SELECT ON ALL TABLES IN SCHEMA hub TO rigd_hub_reader;
GRANT SELECT ON hub.bench, hub.journal, hub.run, hub.stretch, hub.record, hub.clash TO rigd_hub_bench;

ALTER TABLE hub.bench ENABLE ROW LEVEL SECURITY;
ALTER TABLE hub.journal ENABLE ROW LEVEL SECURITY;
ALTER TABLE hub.run ENABLE ROW LEVEL SECURITY;
ALTER TABLE hub.stretch ENABLE ROW LEVEL SECURITY;
ALTER TABLE hub.record ENABLE ROW LEVEL SECURITY;
ALTER TABLE hub.clash ENABLE ROW LEVEL SECURITY;

CREATE POLICY own ON hub.bench FOR SELECT TO rigd_hub_bench USING (id = hub.own_bench());
CREATE POLICY own ON hub.journal FOR SELECT TO rigd_hub_bench USING (bench = hub.own_bench());
CREATE POLICY own ON hub.run FOR SELECT TO rigd_hub_bench USING (bench = hub.own_bench());
CREATE POLICY own ON hub.stretch FOR SELECT TO rigd_hub_bench
    USING (EXISTS (SELECT FROM hub.run AS r WHERE r.id = run AND r.bench = hub.own_bench()));
CREATE POLICY own ON hub.record FOR SELECT TO rigd_hub_bench
    USING (EXISTS (SELECT FROM hub.run AS r WHERE r.id = run AND r.bench = hub.own_bench()));
CREATE POLICY own ON hub.clash FOR SELECT TO rigd_hub_bench USING (bench = hub.own_bench());

CREATE POLICY everything ON hub.bench FOR SELECT TO rigd_hub_reader USING (true);
CREATE POLICY everything ON hub.journal FOR SELECT TO rigd_hub_reader USING (true);
CREATE POLICY everything ON hub.run FOR SELECT TO rigd_hub_reader USING (true);
CREATE POLICY everything ON hub.stretch FOR SELECT TO rigd_hub_reader USING (true);
CREATE POLICY everything ON hub.record FOR SELECT TO rigd_hub_reader USING (true);
CREATE POLICY everything ON hub.clash FOR SELECT TO rigd_hub_reader USING (true);
