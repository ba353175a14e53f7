"""Stiffness of each sample from the touches of a run, with pandas.

Usage: load_pandas.py FOLDER      (needs pandas and pyarrow)
"""

import sys
from pathlib import Path

import pandas

touches = pandas.read_parquet(Path(sys.argv[1]) / "touches.parquet")
measured = touches[touches["status"] == "measured"]
print(measured.groupby("sample")["stiffness_mpa"].describe()[["count", "mean", "std"]])

# Each resonance in contact has its readings in another table.
readings = pandas.read_parquet(Path(sys.argv[1]) / "readings.parquet")
first = measured.iloc[0]
sweep = readings[readings["sweep"] == first["sweep"]]
print(f"{first['step']}: {first['resonance_hz']:.3f} Hz from {len(sweep)} readings")
