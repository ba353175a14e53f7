#!/usr/bin/env python3
"""Reads the tables of a run with pandas, Polars, DuckDB and h5py and holds the type of every column against
docs/data.md.

Usage: tables.py RIGD   (the program; the run is of samples whose names look like numbers)
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import duckdb
import h5py
import pandas
import polars
import pyarrow.parquet

from bench import SCENE, check, equal

LABELS = ("sample", "class")
WHOLE = ("repeat", "no_load_sweep", "next_no_load_sweep", "sweep", "readings", "reading", "try", "attempts", "clock")
WORDS = ("step", "phase", "direction", "status", "reason", "started_at", "run_id", "purpose", "outcome",
         "flag", "fit_timing", "amended", "earlier", "model_verdict", *LABELS)
FLAGS = ("is_simulated", "is_used", "is_confirmed", "is_slip_checked", "is_reference_steady", "fit_always_loss")
# Without a value in a run whose references are not measured by drift: a CSV file then says nothing of its type.
EMPTY = ("next_no_load_sweep",)


def kind(column):
    for kind, names in (("whole", WHOLE), ("text", WORDS), ("flag", FLAGS)):
        if column in names:
            return kind
    return "number"


def by_pandas(path):
    labels = {name: str for name in LABELS}
    frame = pandas.read_csv(path, dtype=labels)
    kinds = {"i": "whole", "f": "number", "b": "flag"}
    return {name: kinds.get(frame[name].dtype.kind, "text") for name in frame}, frame


def by_polars(path):
    header = path.read_text().split("\n", 1)[0].split(",")
    labels = {name: polars.String for name in LABELS if name in header}
    # The first sweep knows no noise, and it can be longer than the rows from which Polars infers types.
    frame = polars.read_csv(path, schema_overrides=labels, infer_schema_length=None)
    kinds = {polars.Int64: "whole", polars.Float64: "number", polars.Boolean: "flag"}
    return {name: kinds.get(dtype, "text") for name, dtype in frame.schema.items()}, frame


def by_duckdb(path):
    rows = duckdb.sql(f"describe select * from '{path}'").fetchall()
    kinds = {"BIGINT": "whole", "DOUBLE": "number", "BOOLEAN": "flag"}
    return {name: kinds.get(dtype, "text") for name, dtype, *_ in rows}, None


def parquet(table, data, from_csv):
    """The Parquet file has the types, units and meanings of all columns, and the values of the CSV file."""
    path = data / f"{table}.parquet"
    rows = duckdb.sql(f"describe select * from '{path}'").fetchall()
    kinds = {"BIGINT": "whole", "DOUBLE": "number", "BOOLEAN": "flag", "VARCHAR": "text",
             "TIMESTAMP WITH TIME ZONE": "text"}
    equal({name: kinds[dtype] for name, dtype, *_ in rows}, {name: kind(name) for name, *_ in rows}, table)
    frame, with_polars = pandas.read_parquet(path), polars.read_parquet(path)
    equal((list(frame), len(frame)), (with_polars.columns, len(with_polars)), f"{table}.parquet")
    described = json.loads(polars.read_parquet_metadata(path)["rigd:columns"])
    equal([column["name"] for column in described], list(frame), f"{table}: described columns")
    check(all(column["description"] for column in described), f"{table}: a column without a meaning")
    fields = pyarrow.parquet.read_schema(path)
    for column in described:
        found = {key: text.decode() for key, text in (fields.field(column["name"]).metadata or {}).items()}
        wanted = {b"unit": column["unit"], b"description": column["description"]}
        equal({key: found.get(key, "") for key in wanted}, wanted, f"{table}.{column['name']}: of its field")
    check(any(field.metadata.get(b"unit") for field in fields), f"{table}: no column has a unit")
    equal((list(from_csv), len(from_csv)), (list(frame), len(frame)), f"{table}.csv and {table}.parquet")
    for column in frame:
        if kind(column) == "number":
            # CSV has three digits of a standard deviation, which may be more than the loss itself.
            atol = 1e-3 if "loss_tangent" in column else 0
            pandas.testing.assert_series_equal(
                from_csv[column], frame[column], check_dtype=False, rtol=5e-3, atol=atol)


def hdf5(rigd, data, folder):
    """The HDF5 file has every column of every table with its values, its unit and its meaning."""
    path = folder / "tables.h5"
    export = [rigd, "export", "latest", "latest", "--data", folder, "--format", "hdf5", "--out", path]
    subprocess.run(export, check=True)
    with h5py.File(path) as file:
        equal(sorted(file), ["readings", "searches", "sweeps", "touches"], "groups")
        for table, group in file.items():
            check(group.attrs["description"], f"{table}: no description")
            # Of two runs, which are the same one here.
            once = pandas.read_parquet(data / f"{table}.parquet")
            frame = pandas.concat([once, once], ignore_index=True)
            equal(sorted(group), sorted([*frame, "run"]), f"{table}: columns")
            for field in pyarrow.parquet.read_schema(data / f"{table}.parquet"):
                found, wanted = group[field.name], frame[field.name]
                unit = (field.metadata.get(b"unit") or b"").decode()
                if field.name != "started_at":
                    equal(found.attrs.get("units", ""), unit, f"{table}.{field.name}: units")
                equal(found.attrs["description"], field.metadata[b"description"].decode(), field.name)
                if kind(field.name) == "text" and field.name != "started_at":
                    equal(list(found.asstr()), list(wanted.fillna("")), f"{table}.{field.name}")
                else:
                    missing = found.attrs.get("missing_value", float("nan"))
                    numbers = wanted.astype("int64" if field.name == "started_at" else "float64")
                    equal(list(numbers.fillna(missing).fillna(0)),
                          [0 if one != one else one for one in found[:].astype("float64")], field.name)
    print("HDF5: every column has its values, its unit and its meaning in h5py")


def run(rigd, folder):
    """A run with refused touches and one that is measured again, so that no column is empty throughout: two
    resonances of the stiffer sample, at 232 Hz, lie above the window."""
    protocol = Path("config/protocols/smoke.toml").read_text()
    protocol = protocol.replace("[no_load_sweep]", "[no_load_sweep]\nsurvey_s = 10")
    head, contact = protocol.replace('["1", "5"]', '["01", "05"]').split("[contact_sweep]")
    contact = contact.replace("max_hz = 260", 'max_hz = 231\nmethod = "uniform"\nsettle_s = 0.2\npoints = 31')
    (folder / "protocol.toml").write_text(f"{head}[contact_sweep]{contact}")
    scene = Path(SCENE).read_text()
    for sample in "12345":
        scene = scene.replace(f'name = "{sample}"', f'name = "0{sample}"')
    (folder / "scene.toml").write_text(scene)
    rig = Path("config/rigs/simulated.toml").read_text().replace("../scenes/paper.toml", "scene.toml")
    (folder / "rig.toml").write_text(rig)
    options = ["--rig", folder / "rig.toml", "--data", folder, "--json"]
    done = subprocess.run([rigd, "run", folder / "protocol.toml", *options], capture_output=True, text=True)
    equal(done.returncode, 6, f"exit code ({done.stderr})")
    # A touch whose shift is large and whose resonance lies inside the window in any mounting.
    redo = [rigd, "redo", "latest", "main/05/back/45/1", "--why", "for the table", *options]
    done = subprocess.run(redo, capture_output=True, text=True)
    equal(done.returncode, 0, f"exit code ({done.stderr})")
    return json.loads(done.stdout)


def main():
    with tempfile.TemporaryDirectory() as folder:
        result = run(sys.argv[1], Path(folder))
        data = Path(result["data"])
        for table in ("touches", "sweeps", "readings", "searches"):
            path = data / f"{table}.csv"
            # pandas comes last: its frame is compared with the Parquet file.
            for reader in (by_polars, by_duckdb, by_pandas):
                kinds, frame = reader(path)
                for column, found in kinds.items():
                    if column in EMPTY and reader is not by_pandas:
                        continue
                    # pandas has no whole numbers or flags with gaps, and no column of a type but no value.
                    has_gaps = reader is by_pandas and frame[column].isna().any()
                    with_gaps = {"whole": "number", "text": "number", "flag": "text"}.get(kind(column))
                    if not (has_gaps and found == with_gaps):
                        equal(found, kind(column), f"{reader.__name__}: {table}.csv, {column}")
                if table == "touches" and frame is not None:
                    equal(sorted(set(frame["sample"])), ["01", "05"], f"{reader.__name__}: labels")
                    equal(len(frame), result["touches_planned"], f"{reader.__name__}: rows")
            parquet(table, data, frame)
            print(f"{table}: {len(kinds)} columns have their types in pandas, Polars and DuckDB, as CSV and Parquet")
        hdf5(sys.argv[1], data, Path(folder))
        check(result["touches_refused"] > 0, "no touch was refused")


main()
