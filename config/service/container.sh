#!/usr/bin/env bash
# Builds the container image of a program that is built already: container.sh RIGD [NAME]. It needs buildah,
# podman or docker, and no base image.
set -euo pipefail
rigd=$(realpath "$1") name=${2:-rigd}
cd "$(dirname "$0")/../.."
context=$(mktemp -d)
trap 'rm -rf "$context"' EXIT
root=$context/root
install -D "$rigd" "$root/usr/bin/rigd"
strip "$root/usr/bin/rigd"
# The loader and the libraries, where the program looks for them.
ldd "$rigd" | grep -o '/[^ ]*' | while read -r library; do install -D "$(realpath "$library")" "$root$library"; done
mkdir -p "$root/usr/share/rigd" "$root/etc"
cp -r config/protocols config/rigs config/scenes "$root/usr/share/rigd/"
printf 'rigd:x:8137:8137:rigd:/data:/usr/bin/rigd\n' > "$root/etc/passwd"
printf 'rigd:x:8137:\n' > "$root/etc/group"
install -d -m 1777 "$root/tmp"
mkdir "$context/data"
builder=$(command -v buildah || command -v podman || command -v docker) ||
  { printf 'no buildah, podman or docker\n' >&2; exit 1; }
"$builder" build --tag "$name" --file config/service/Containerfile "$context"
