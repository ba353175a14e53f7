#!/usr/bin/env bash
# Plays a campaign from a queue of a nats-server with JetStream that is begun for it in a temporary directory, by three workers of
# which one is killed, and compares the merged page with that of one process.
#
#   queue.sh CAMPAIGN [SEEDS]       with Debian's nats-server
#
# SEEDS is the number of seeds of each of eight chunks, 10 if left out.
set -euo pipefail
campaign=$(realpath "$1")
chunks=8 seeds=${2:-10}
work=$(mktemp -d)
cleanup() {
  # One that stands still too.
  kill -KILL $(jobs -p) 2> /dev/null || true
  wait || true
  rm -rf "$work"
}
trap cleanup EXIT
PATH=$PATH:/usr/sbin
# On a port that is free.
nats-server --addr 127.0.0.1 --port -1 --jetstream --store_dir "$work/store" --ports_file_dir "$work" 2> "$work/server.log" &
ports=$work/nats-server_$!.ports
for _ in {1..100}; do
  [ -s "$ports" ] && break
  sleep 0.1
done
url=$(grep -o 'nats://[0-9.:]*' "$ports") || { cat "$work/server.log"; exit 1; }
queue() { "$campaign" --queue "$url" "$@"; }
refuses() {
  local expected=$1
  shift
  ! queue "$@" > "$work/refused" || { echo "not refused: $*"; exit 1; }
  grep -F "$expected" "$work/refused"
}

total=$((chunks * seeds))
refuses 'was not filled for the program' --worker
queue --fill --seeds $total --chunk "$seeds" --silent-s 2
queue --fill --seeds $total --chunk "$seeds" --silent-s 2 | grep "^$chunks chunks: 0 added"
refuses "seeds 1 to $total have no piece" --gather --seeds $total --within-s 0 --page "$work/merged.md"
# Another file is another program.
cp "$campaign" "$work/other"
printf x >> "$work/other"
campaign=$work/other refuses 'it has chunks for' --worker

# One is killed in the middle of a chunk.
touch "$work/killed.log"
"$campaign" --queue "$url" --worker > "$work/killed.log" &
killed=$!
for _ in {1..300}; do
  # While it stands still: what it says after a chunk is another line, and that comes after the acknowledgement.
  kill -STOP $killed
  queue --gather --seeds $total --within-s 0 --page "$work/merged.md" > "$work/taken" || true
  [[ $(tail -1 "$work/killed.log") == seeds* ]] && grep -qF 'and 1 were taken' "$work/taken" && break
  kill -CONT $killed
  sleep 0.1
done
kill -KILL $killed
wait $killed || true
lost=$(tail -1 "$work/killed.log")
[[ $lost == seeds* ]] || { echo "no worker was killed in the middle of a chunk: $lost"; exit 1; }
workers=()
for worker in 1 2; do
  "$campaign" --queue "$url" --worker > "$work/$worker.log" &
  workers+=($!)
done
queue --gather --seeds $total --page "$work/merged.md"
for worker in "${workers[@]}"; do wait "$worker"; done
cat "$work"/[12].log | grep '^seeds'
# Another worker has played it.
again=${lost/worker 1/worker 2}
grep -qF "$again" "$work"/[12].log || { echo "nobody has played again what was lost: $lost"; exit 1; }
# Once more, it is the same.
cp "$work/merged.json" "$work/first.json"
queue --gather --seeds $total --page "$work/merged.md" > /dev/null
cmp "$work/merged.json" "$work/first.json"

"$campaign" --seeds $total --jobs "$(nproc)" --page "$work/alone.md" > /dev/null
# The counts; the pieces have other seconds.
counts() { sed -n '/^## Counts/,/^## Pieces/p' "$1"; }
cmp <(counts "$work/merged.md") <(counts "$work/alone.md")
printf '%s chunks of %s seeds, one of them begun by a worker that was killed: the merged page has the counts of one process\n' \
  "$chunks" "$seeds"
