"""The mean shift of each sample over all benches and runs of an object store, with DuckDB.

Usage: store_duckdb.py STORE      (needs duckdb; STORE is the directory of `rigd ship folder:STORE`)
"""

import sys

import duckdb

duckdb.sql(f"""
    SELECT lab, bench, payload ->> '$.touch.sample' AS sample,
           count(*) AS touches, count(DISTINCT run_id) AS runs,
           round(avg((payload ->> '$.shift_hz')::DOUBLE), 2) AS shift_hz
    FROM read_parquet('{sys.argv[1]}/**/*.parquet', hive_partitioning = true)
    WHERE kind = 'touch_result'
    GROUP BY ALL ORDER BY ALL
""").show()
