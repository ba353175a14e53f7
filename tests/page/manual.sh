#!/usr/bin/env bash
# Takes the pictures of the manual from the running page: manual.sh RIGD
set -euo pipefail
rigd=$(realpath "$1")
cd "$(dirname "$0")"
shots=$(mktemp -d)
trap 'rm -r "$shots"' EXIT
./run.sh "$rigd" "$shots"
for screen in protocols running prompt-sample run; do
  cp "$shots/$screen-small-light.png" "../../docs/pictures/$screen.png"
done
