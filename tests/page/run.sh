#!/usr/bin/env bash
# Walks through the page with a real browser: run.sh RIGD [DIRECTORY FOR SCREENSHOTS [HOURS]]
# The hours are those of the events that a page left open gets, faster than they happen; 1 if left out.
set -euo pipefail
rigd=$(realpath "$1")
shots=${2:-$(mktemp -d)}
mkdir -p "$shots"
shots=$(realpath "$shots")
cd "$(dirname "$0")"
npm ci --no-fund --no-audit
node page.test.mjs "$rigd" "$shots"
exec node growth.mjs "$rigd" "$shots" "${3:-1}"
