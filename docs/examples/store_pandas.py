"""The drift of the free resonance of each bench, from all runs of an object store, with pandas.

Usage: store_pandas.py STORE      (needs pandas and pyarrow; STORE is the directory of `rigd ship folder:STORE`)
"""

import json
import sys

import pandas

# Touches that were measured again are in amendments, which are runs of their own and may be of another day.
records = pandas.read_parquet(sys.argv[1], filters=[("kind", "=", "touch_result"), ("run_kind", "=", "run")])
touches = pandas.json_normalize(records["payload"].map(json.loads).tolist())
touches[["lab", "bench", "run_id", "at"]] = records[["lab", "bench", "run_id", "at"]].reset_index(drop=True)
free = touches.sort_values("at").groupby(["lab", "bench", "run_id"], observed=True)["no_load_hz"]
print((free.last() - free.first()).rename("drift_hz"))
