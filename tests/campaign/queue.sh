#!/usr/bin/env bash
# Plays a campaign, and computes studies, from a queue of a nats-server with JetStream that is begun for it in a temporary directory, by
# three workers of which one is killed, and compares the merged pages with those of one process.
#
#   queue.sh CAMPAIGN [RIG_STUDY [SEEDS]]       with Debian's nats-server
#
# SEEDS is the number of seeds of each of eight chunks, 10 if left out.
set -euo pipefail
campaign=$(realpath "$1")
study=${2:+$(realpath "$2")}
chunks=8 seeds=${3:-10}
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
refuses() {
  local expected=$1
  shift
  ! "$@" > "$work/refused" 2>&1 || { echo "not refused: $*"; exit 1; }
  grep -F "$expected" "$work/refused"
}
# Fills the queue, computes all of it by three workers of which one is killed in the middle of a chunk, and gathers twice.
#   from_queue CHUNKS 'FILL' 'GATHER' 'WHAT IS COMPARED' PROGRAM [ARGUMENTS]
from_queue() {
  local chunks=$1 fill=$2 gather=$3 compared=$4 program=$5 killed lost again workers=() worker
  shift 4
  local queue=("$@" --queue "$url")
  refuses 'was not filled for' "${queue[@]}" --worker
  "${queue[@]}" --fill $fill --silent-s 2
  "${queue[@]}" --fill $fill --silent-s 2 | grep "^$chunks chunks: 0 added"
  refuses 'there is no piece of' "${queue[@]}" --gather $gather --within-s 0
  # Another file is another program.
  cp "$program" "$work/other"
  printf x >> "$work/other"
  refuses 'it has chunks for' "$work/other" "${queue[@]:1}" --worker

  touch "$work/killed.log"
  "${queue[@]}" --worker > "$work/killed.log" &
  killed=$!
  for _ in {1..300}; do
    # While it stands still: what it says after a chunk is another line, and that comes after the acknowledgement.
    kill -STOP $killed
    "${queue[@]}" --gather $gather --within-s 0 > "$work/taken" 2>&1 || true
    [[ $(tail -1 "$work/killed.log") == *', worker '* ]] && grep -qF 'and 1 were taken' "$work/taken" && break
    kill -CONT $killed
    sleep 0.1
  done
  kill -KILL $killed
  wait $killed || true
  lost=$(tail -1 "$work/killed.log")
  [[ $lost == *', worker '* ]] || { echo "no worker was killed in the middle of a chunk: $lost"; exit 1; }
  for worker in 1 2; do
    "${queue[@]}" --worker > "$work/$worker.log" &
    workers+=($!)
  done
  "${queue[@]}" --gather $gather
  for worker in "${workers[@]}"; do wait "$worker"; done
  cat "$work"/[12].log | grep ', worker '
  # Another worker has computed it.
  again=${lost/worker 1/worker 2}
  grep -qF "$again" "$work"/[12].log || { echo "nobody has computed again what was lost: $lost"; exit 1; }
  # Once more, it is the same.
  cp -r "$compared" "$work/first"
  "${queue[@]}" --gather $gather > /dev/null
  diff -r "$compared" "$work/first"
  rm -r "$work/first"
}

total=$((chunks * seeds))
from_queue $chunks "--seeds $total --chunk $seeds" "--seeds $total --page $work/merged.md" "$work/merged.json" "$campaign"
"$campaign" --seeds $total --jobs "$(nproc)" --page "$work/alone.md" > /dev/null
# The counts; the pieces have other seconds.
counts() { sed -n '/^## Counts/,/^## Pieces/p' "$1"; }
cmp <(counts "$work/merged.md") <(counts "$work/alone.md")
printf '%s chunks of %s seeds, one of them begun by a worker that was killed: the merged page has the counts of one process\n' \
  "$chunks" "$seeds"

[ -n "$study" ] || exit 0
# Small ones.
check() {
  local name=$1 chunks=$2
  shift 2
  # First: what is gathered is not read from its rows.
  "$study" "$name" "$@" --out "$work/$name-alone" > /dev/null
  from_queue "$chunks" "" "--out $work/$name-merged" "$work/$name-merged" "$study" "$name" "$@" --chunks "$chunks"
  diff -r "$work/$name-merged" "$work/$name-alone"
  refuses 'was not filled for' "$study" "$name" "$@" --chunks 2 --queue "$url" --worker
  printf '%s in %s chunks, one of them begun by a worker that was killed: the merged page has the bytes of one process\n' \
    "$name" "$chunks"
}
check failures 3 --axis second-mode-20 --seeds 2 --trials 1 --planned 1
check design 6 --length-mm 20:50:6 --radius-mm 0.2:1:400 --indentation-mm 0.1:0.5:20 --rows "$work/rows/design.csv"
