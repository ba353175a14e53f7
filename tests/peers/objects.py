"""Reads an object store with DuckDB, polars and pandas, computes every digest and seal again, and compares the records with
a journal byte for byte.

Usage: objects.py STORE DATA      (needs duckdb, polars, pandas, pyarrow)
"""

import hashlib
import json
import sqlite3
import sys
from pathlib import Path

import duckdb
import pandas
import polars
import pyarrow.parquet

store, data = Path(sys.argv[1]), Path(sys.argv[2])


def digest(*parts):
    sha = hashlib.sha256()
    for part in parts:
        if isinstance(part, int):
            sha.update(part.to_bytes(8, "big"))
        elif isinstance(part, str):
            text = part.encode()
            sha.update(len(text).to_bytes(8, "big") + text)
        else:
            sha.update(part)
    return sha.digest()


found = {}
for path in store.rglob("*.parquet"):
    seal = json.loads(pyarrow.parquet.read_metadata(path).metadata[b"rigd:seal"])
    rows = pyarrow.parquet.read_table(path, partitioning=None).to_pylist()
    last = bytes(32)
    for number, row in enumerate(rows, 1):
        assert row["seq"] == number, path
        last = digest(last, row["seq"], row["rig_us"], row["kind"], row["payload"])
        assert last.hex() == row["digest"], f"{path}: record {number}"
    assert (seal["records"], seal["head"]) == (len(rows), last.hex()), path
    stretches = [part for one in seal["stretches"] for part in (one["epoch"], one["started_at"], one["rig_us"])]
    entry = [seal[key] for key in ("bench_id", "journal_id", "run_id", "kind", "name", "record_format", "epoch", "started_at")]
    end = [seal["finished_at"], seal["status"], seal["records"], last]
    assert digest(*entry, *stretches, *end).hex() == seal["seal"], path
    assert path.name == f"{seal['run_id']}.{seal['head'][:8]}.parquet", path
    receipt = json.loads((path.parent / f"_{path.stem}.seal.json").read_text())
    assert receipt["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest(), path
    found[seal["run_id"]] = [(row["seq"], row["epoch"], row["rig_us"], row["kind"], row["payload"], row["digest"]) for row in rows]

journal = sqlite3.connect(data / "rigd.db")
sealed = journal.execute("SELECT key, id FROM runs JOIN seals ON seals.run = key").fetchall()
assert sealed
for key, run in sealed:
    rows = journal.execute(
        "SELECT seq, epoch, rig_us, kind, payload, lower(hex(digest)) FROM records WHERE run = ? ORDER BY seq", (key,)
    ).fetchall()
    assert found.get(run) == rows, f"run {run} differs from the journal"

count = sum(map(len, found.values()))
glob = f"{store}/**/*.parquet"
by_duckdb = duckdb.sql(f"SELECT count(*), count(DISTINCT bench) FROM read_parquet('{glob}', hive_partitioning = true)").fetchall()[0]
by_polars = polars.scan_parquet(glob, hive_partitioning=True).select(polars.len(), polars.col("bench").n_unique()).collect().row(0)
table = pandas.read_parquet(store)
by_pandas = (len(table), table["bench"].nunique())
assert by_duckdb == by_polars == by_pandas and by_pandas[0] == count, (by_duckdb, by_polars, by_pandas, count)
size = sum(path.stat().st_size for path in store.rglob("*.parquet"))
print(f"{len(found)} objects, {count} records, {size / count:.0f} bytes a record: digests, seals and journal agree")
