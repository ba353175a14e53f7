#!/usr/bin/env bash
# Plays disks that are full: PostgreSQL and an object store each have a small file system of their own. Called as
# `tests/hub/full_disk.sh HUB_CAMPAIGN`, as root: it mounts two file systems in memory, which only it sees.
set -euo pipefail
program=$(realpath "$1")
disks=$(mktemp -d)
trap 'rm -r "$disks"' EXIT
chmod 755 "$disks"
unshare --mount bash -euc '
  mkdir "$2/database" "$2/objects"
  mount -t tmpfs -o size=160m,mode=1777 database "$2/database"
  mount -t tmpfs -o size=4m,mode=755 objects "$2/objects"
  "$1" full-disk "$2/database" "$2/objects"
' full_disk "$program" "$disks"
