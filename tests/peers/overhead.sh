#!/usr/bin/env bash
# Prints how long one transaction takes through rigd's drivers, beside libmodbus, pymodbus and PyVISA
# on the same pseudo-terminals and sockets in the same run. It judges nothing: machines are noisy.
#
# Usage: overhead.sh PYTHON RIG_SIM   (needs a C compiler, libmodbus-dev and socat)
set -euo pipefail
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-target}
cargo build --release --locked --quiet -p rig-stage --example bus_overhead
cargo build --release --locked --quiet -p rig-analyzer --example analyzer_overhead
libmodbus=$target/release/examples/libmodbus_overhead
cc -O2 -Wall -Wextra -I/usr/include/modbus -o "$libmodbus" tests/peers/overhead.c -lmodbus
exec "$1" tests/peers/overhead.py "$2" "$target/release/examples"
