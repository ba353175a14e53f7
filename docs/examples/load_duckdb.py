"""The stiffness of each sample over all runs of a data directory, with DuckDB.

Usage: load_duckdb.py 'DATA/runs/*'      (needs duckdb; FOLDER alone reads one run)
"""

import sys

import duckdb

duckdb.sql(f"""
    SELECT sample, count(*) AS touches, round(avg(stiffness_mpa), 4) AS stiffness_mpa,
           round(stddev(stiffness_mpa), 4) AS scatter_mpa, count(DISTINCT run_id) AS runs
    FROM read_parquet('{sys.argv[1]}/touches.parquet')
    WHERE status = 'measured'
    GROUP BY sample ORDER BY sample
""").show()
