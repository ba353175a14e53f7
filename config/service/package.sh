#!/usr/bin/env bash
# Builds the Debian package of the program in target/release, with its software bill of materials:
# package.sh OUT.deb [REVISION]. It needs cargo-deb and cargo-cyclonedx (`cargo install cargo-deb
# cargo-cyclonedx --locked`).
set -euo pipefail
out=$(realpath -m "$1") revision=${2:-1}
cd "$(dirname "$0")/../.."
rigd=target/release/rigd
[ -x "$rigd" ] || { printf 'build it first: cargo build --release --locked -p rigd\n' >&2; exit 1; }
rm -rf target/package
mkdir -p target/package/man
"$rigd" man target/package/man > /dev/null
gzip -9 -n target/package/man/*.1
for shell in bash zsh fish; do "$rigd" completions "$shell" > "target/package/rigd.$shell"; done
# The same commit gives the same bytes.
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH
# It writes one file beside each Cargo.toml of the workspace; that of rigd has all its dependencies.
bill=bill-of-materials.cdx
trap 'find . -name "$bill.json" -not -path "./target/*" -delete' EXIT
cargo cyclonedx --quiet --format json --override-filename "$bill" --manifest-path crates/rigd/Cargo.toml
sed "s|$PWD|/rigd|g" "crates/rigd/$bill.json" > target/package/rigd.cdx.json
cargo deb --package rigd --locked --no-build --quiet --deb-revision "$revision" --output "$out"
dpkg-deb --info "$out" | sed -n 's/^ \(Package\|Version\|Installed-Size\|Depends\)/\1/p'
