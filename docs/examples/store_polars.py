"""The records of each kind over all benches and runs of an object store, with polars.

Usage: store_polars.py STORE      (needs polars; STORE is the directory of `rigd ship folder:STORE`)
"""

import sys

import polars

records = polars.scan_parquet(f"{sys.argv[1]}/**/*.parquet", hive_partitioning=True)
print(
    records.filter(polars.col("run_kind") == "run")
    .group_by("lab", "bench", "month", "kind")
    .agg(polars.len().alias("records"), polars.col("run_id").n_unique().alias("runs"))
    .sort("lab", "bench", "month", "records", descending=[False, False, False, True])
    .collect()
)
