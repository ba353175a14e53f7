#!/usr/bin/env bash
# Builds the page that rigd serves at /. Run it after every change in src/ and commit dist/ with it:
# cargo takes the files from there, so that building rigd needs no Node. The directory to build into
# may be given; the gate builds into another one and compares.
set -euo pipefail
cd "$(dirname "$0")"
npm ci --no-fund --no-audit
npm run check
npm test
npm run build -- "${1:-dist}"
