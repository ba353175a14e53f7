#!/usr/bin/env bash
# Walks through the page with a real browser: run.sh RIGD [DIRECTORY FOR SCREENSHOTS]
set -euo pipefail
rigd=$(realpath "$1")
shots=${2:-$(mktemp -d)}
mkdir -p "$shots"
shots=$(realpath "$shots")
cd "$(dirname "$0")"
npm ci --no-fund --no-audit
exec node page.test.mjs "$rigd" "$shots"
