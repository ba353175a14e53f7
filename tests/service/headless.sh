#!/usr/bin/env bash
# One command for headless CI: starts rigd on simulated instruments, runs a protocol over HTTP, checks the
# results, and exits with 0 only if every touch was measured and the journal is sound.
#   tests/service/headless.sh target/release/rigd config/protocols/smoke.toml
# Needs curl and python3. In a pipeline: build or install rigd, then this script with your own protocol, with
# RIG=your/rig.toml for a rig file that names your own scene.
set -euo pipefail
rigd=$(realpath "$1") protocol=$2 rig=${RIG:-config/rigs/simulated.toml}
data=$(mktemp -d)
trap 'kill "$daemon" 2>/dev/null || true; wait "$daemon" 2>/dev/null || true; rm -rf "$data"' EXIT
"$rigd" serve "$protocol" --rig "$rig" --data "$data" --listen 127.0.0.1:0 2> "$data/log" &
daemon=$!
for _ in $(seq 600); do
  url=$(grep -om1 'http://[0-9.:]*' "$data/log" || true)
  [ -n "$url" ] && curl -sf "$url/readyz" > /dev/null && break
  kill -0 "$daemon" || { cat "$data/log" >&2; exit 1; }
  sleep 0.1
done
run=$(curl -sSf -X POST -H "Idempotency-Key: headless" "$url/api/v1/runs" |
  python3 -c 'import json, sys; print(json.load(sys.stdin)["id"])')
"$rigd" watch --data "$data" > /dev/null
curl -sSf "$url/api/v1/runs/$run" | python3 -c '
import json, sys
run = json.load(sys.stdin)
results = run["results"]
model = (results.get("model") or {}).get("verdict", "was not judged")
measured, planned = results["touches_measured"], results["touches_planned"]
print(run["status"], f"{measured} of {planned} touches; the model {model}")
sys.exit(run["status"] != "completed" or measured != planned)'
kill -TERM "$daemon"
wait "$daemon"
"$rigd" verify "$run" --data "$data"
