#!/usr/bin/env bash
# The resonance fit beside scipy, lmfit and scikit-rf: the same sweeps, one run, one table.
#
# Usage: fit.sh [--quick] [--seed N]
#
# With --quick only the agreement with scipy is looked at, in seconds; times of so few calls on a busy
# machine mean nothing. Exits with 1 where rigd and scipy disagree.
set -euo pipefail
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-target}
venv=$target/speed-peers
# One thread each.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
cargo build --release --locked --quiet -p rig-tests --bin speed
if ! cmp --silent tests/speed/requirements.txt "$venv/installed.txt"; then
  rm -rf "$venv"
  python3 -m venv "$venv"
  "$venv/bin/pip" install --quiet --disable-pip-version-check -r tests/speed/requirements.txt
  cp tests/speed/requirements.txt "$venv/installed.txt"
fi
exec "$venv/bin/python" tests/speed/fit.py "$target/release/speed" "$@"
