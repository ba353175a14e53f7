"""Shift against contact angle of each sample and direction, with polars.

Usage: load_polars.py FOLDER      (needs polars)
"""

import json
import sys
from pathlib import Path

import polars

path = Path(sys.argv[1]) / "touches.parquet"
shifts = (
    polars.scan_parquet(path)
    .filter(polars.col("status") == "measured", polars.col("phase") == "main")
    .group_by("sample", "direction", "angle_deg")
    .agg(polars.mean("shift_hz"), polars.len().alias("touches"))
    .sort("sample", "direction", "angle_deg")
    .collect()
)
print(shifts)

# The file says what each column means.
for column in json.loads(polars.read_parquet_metadata(path)["rigd:columns"]):
    if column["name"] in shifts.columns:
        print(f"{column['name']} [{column['unit']}]: {column['description']}")
