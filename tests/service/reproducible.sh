#!/usr/bin/env bash
# Builds rigd twice, in two clones at different places, and compares the programs byte for byte. It takes twice
# the time of a release build.
set -euo pipefail
cd "$(dirname "$0")/../.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cargo_home=${CARGO_HOME:-$HOME/.cargo}
for place in one two/deeper; do
  git clone --quiet . "$work/$place"
  # Paths of this computer are not part of the program.
  (
    cd "$work/$place"
    export RUSTFLAGS="--remap-path-prefix=$PWD=/rigd --remap-path-prefix=$cargo_home=/cargo"
    export CFLAGS="-ffile-prefix-map=$PWD=/rigd -ffile-prefix-map=$cargo_home=/cargo"
    cargo build --quiet --release --locked -p rigd
    strip target/release/rigd
    sha256sum target/release/rigd
  )
done
cmp "$work/one/target/release/rigd" "$work/two/deeper/target/release/rigd"
printf 'the two programs are the same\n'
