#!/usr/bin/env bash
# Prints how long one transaction takes through rigd's drivers, beside libmodbus, pymodbus and PyVISA
# on the same pseudo-terminals and sockets in the same run. It judges nothing: machines are noisy.
#
# Usage: transaction.sh PYTHON RIG_SIM   (needs a C compiler, libmodbus-dev and socat)
set -euo pipefail
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-target}
cargo build --release --locked --quiet -p rig-tests --bin speed
libmodbus=$target/release/libmodbus-speed
cc -O2 -Wall -Wextra -I/usr/include/modbus -o "$libmodbus" tests/speed/libmodbus.c -lmodbus
PYTHONPATH=tests/peers exec "$1" tests/speed/transaction.py "$2" "$target/release"
