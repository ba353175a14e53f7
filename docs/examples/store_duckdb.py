"""The mean shift of each sample over all benches and runs of an object store, with DuckDB.

Usage: store_duckdb.py STORE      (needs duckdb; STORE is the directory of `rigd ship folder:STORE`)
"""

import sys

import duckdb

# An amendment is a run of its own, with a later id, whose name is the id of the amended run. What was said last of a
# touch holds: a result, a refusal, or that it is skipped.
duckdb.sql(f"""
    WITH said AS (
        SELECT lab, bench, run_id, seq, kind, payload,
               CASE WHEN run_kind = 'amendment' THEN run_name ELSE run_id END AS run,
               coalesce(payload ->> '$.touch.step', payload ->> '$.step') AS step
        FROM read_parquet('{sys.argv[1]}/**/*.parquet', hive_partitioning = true)
        WHERE kind IN ('touch_result', 'touch_refused') OR (kind = 'amended' AND payload ->> '$.what' = 'skip')
    )
    SELECT lab, bench, payload ->> '$.touch.sample' AS sample,
           count(*) AS touches, count(DISTINCT run) AS runs,
           round(avg((payload ->> '$.shift_hz')::DOUBLE), 2) AS shift_hz
    FROM (FROM said QUALIFY row_number() OVER (PARTITION BY run, step ORDER BY run_id DESC, seq DESC) = 1)
    WHERE kind = 'touch_result'
    GROUP BY ALL ORDER BY ALL
""").show()
