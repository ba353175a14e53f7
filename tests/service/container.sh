#!/usr/bin/env bash
# Builds the container image and measures a run with what is in it: container.sh RIGD, as root, with buildah.
set -euo pipefail
rigd=$(realpath "$1")
cd "$(dirname "$0")/../.."
fail() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
config/service/container.sh "$rigd" rigd-test > /dev/null || fail "the image cannot be built"
container=$(buildah from --pull-never rigd-test)
trap 'buildah rm "$container" > /dev/null; buildah rmi rigd-test > /dev/null' EXIT
[ "$(buildah inspect --format '{{.OCIv1.Config.User}}' "$container")" = 8137:8137 ] || fail "it runs as another user"
root=$(buildah mount "$container")
# Its own files and nothing of this computer, as its own user.
inside() { chroot --userspec=8137:8137 "$root" /usr/bin/rigd "$@"; }
share=/usr/share/rigd
inside run "$share/protocols/smoke.toml" --rig "$share/rigs/simulated.toml" --data /data > /dev/null ||
  fail "the program in the image cannot measure"
inside verify latest --data /data
