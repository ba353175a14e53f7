#!/usr/bin/env bash
# Plays a campaign, and computes studies, as Slurm arrays on a cluster of this computer alone, begun for it in a temporary directory,
# and compares the merged pages with those of one process.
#
#   slurm.sh CAMPAIGN [RIG_STUDY]       as root, with Debian's slurmctld, slurmd, slurm-client and munge
set -euo pipefail
campaign=$(realpath "$1")
study=${2:+$(realpath "$2")}
here=$(cd "$(dirname "$0")" && pwd)
tasks=4 seeds=25
work=$(mktemp -d)
cleanup() {
  kill $(jobs -p) 2> /dev/null || true
  wait || true
  rm -rf "$work"
}
trap cleanup EXIT
chmod 755 "$work"
export SLURM_CONF=$work/slurm.conf
node=$(hostname -s)
dd if=/dev/urandom of="$work/munge.key" bs=1024 count=1 status=none
chown -R munge: "$work/munge.key"
chmod 400 "$work/munge.key"
install -d -o munge "$work/munge"
setpriv --reuid=munge --regid=munge --init-groups munged --foreground --key-file="$work/munge.key" --socket="$work/munge/socket" \
  --pid-file="$work/munge/pid" --log-file="$work/munge/log" --seed-file="$work/munge/seed" 2> "$work/munged.log" &
cat > "$SLURM_CONF" << END
ClusterName=one
SlurmctldHost=$node
SlurmctldPort=26817
SlurmdPort=26818
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$work/munge/socket
CredType=cred/munge
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.log
MailProg=/bin/true
ReturnToService=2
NodeName=$node CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
END
mkdir "$work/state" "$work/spool"
# Each waits for what it needs.
slurmctld -D 2> /dev/null &
slurmd -D 2> /dev/null &
for _ in {1..60}; do
  [ "$(sinfo --noheader --format=%T 2> /dev/null)" = idle ] && break
  sleep 1
done
[ "$(sinfo --noheader --format=%T)" = idle ] || { tail "$work"/*.log; exit 1; }

sbatch --wait --array=0-$((tasks - 1)) --chdir="$here/../.." "$here/array.sbatch" "$campaign" "$work/parts" "$seeds"
ls "$work/parts"
"$campaign" --merge "$work"/parts/*.json --page "$work/merged.md"
# In another order, and one of them twice.
"$campaign" --merge "$work"/parts/{3,1,2,0,1}.json --page "$work/again.md"
cmp "$work/merged.md" "$work/again.md"
cmp "$work/merged.json" "$work/again.json"
"$campaign" --seeds $((tasks * seeds)) --jobs "$(nproc)" --page "$work/alone.md" > /dev/null
# The counts; the pieces have other seconds.
counts() { sed -n '/^## Counts/,/^## Pieces/p' "$1"; }
cmp <(counts "$work/merged.md") <(counts "$work/alone.md")
printf '%s tasks of %s seeds: the merged page has the counts of one process\n' "$tasks" "$seeds"

[ -n "$study" ] || exit 0
# Small ones.
check() {
  local name=$1 chunks=3
  shift
  # First: what is merged is not read from its rows.
  "$study" "$name" "$@" --out "$work/$name-alone" > /dev/null
  sbatch --wait --array=1-$chunks --chdir="$here/../.." "$here/study.sbatch" "$study" "$work/$name" $chunks "$name" "$@"
  "$study" "$name" "$@" --merge "$work/$name/$name"-*-of-$chunks.json --out "$work/$name-merged" > /dev/null
  diff -r "$work/$name-merged" "$work/$name-alone"
  printf '%s in %s tasks: the merged page has the bytes of one process\n' "$name" $chunks
}
check failures --axis second-mode-20 --seeds 2 --trials 1 --planned 1
check design --length-mm 20:50:6 --radius-mm 0.2:1:5 --rows "$work/rows/design.csv"
