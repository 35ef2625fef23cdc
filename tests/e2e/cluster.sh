#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# toolchain/cluster by a real Slurm of one machine, started here: slurmctld, slurmd and munge as whoever runs this, on
# loopback, with ports, key and files of their own. A dataset by 1, 2 and 4 shards has to have the bytes of the single run.
#   tests/e2e/cluster.sh [BIN]      default build/sim/bin
# The last line is "N passed"; status 77: no Slurm.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=tests/e2e/steps.sh
source tests/e2e/steps.sh
PATH=$PATH:/usr/sbin:/sbin
for tool in slurmctld slurmd munged sbatch python3; do
  command -v "$tool" >/dev/null && continue
  echo "SKIPPED: no $tool. Next: tests/run.sh --only packages --long, or apt-get install slurmctld slurmd slurm-client munge"
  exit 77
done
bin=$(realpath "${1:-build/sim/bin}")
work=$(mktemp -d)
chmod 711 "$work"  # munge wants its socket to be within everybody's reach
daemons=()
# Jobs first, which slurmd would leave running; then those behind before those in front.
over() {
  local k
  if ((${#daemons[@]} == 3)); then
    timeout 20 scancel --user="$(id -un)" 2>/dev/null || true
    until_true 20 no_jobs || true
  fi
  for ((k = ${#daemons[@]} - 1; k >= 0; k--)); do
    kill "${daemons[k]}" 2>/dev/null || true
    wait "${daemons[k]}" 2>/dev/null || true
  done
  rm -rf "$work"
}
trap over EXIT
trap 'exit 130' INT TERM
export NO_COLOR=1 SLURM_CONF=$work/slurm.conf HOLDFAST=$bin/holdfast
unset HOLDFAST_SBATCH HOLDFAST_AT_ONCE

# until_true SECONDS COMMAND...: waits for it.
until_true() {
  local end=$((SECONDS + $1))
  shift
  until "$@" >"$work/said" 2>&1; do
    ((SECONDS < end)) || return 1
    sleep 0.2
  done
}
no_jobs() { [[ -z $(timeout 10 squeue -h 2>/dev/null) ]]; }
# start NAME COMMAND...
start() {
  "${@:2}" >"$work/$1.out" 2>&1 </dev/null &
  daemons+=($!)
}

head -c 1024 /dev/urandom >"$work/munge.key"
chmod 600 "$work/munge.key"
mkdir "$work/ctld" "$work/d"
read -r ctld_port d_port < <(python3 -c '
import socket
held = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
print(*(s.getsockname()[1] for s in held))')
machine=$(hostname -s)
cat >"$SLURM_CONF" <<CONF
ClusterName=holdfast-test
SlurmctldHost=$machine(127.0.0.1)
SlurmctldPort=$ctld_port
SlurmdPort=$d_port
# On loopback alone.
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
AuthInfo=socket=$work/munge.socket
CryptoType=crypto/munge
StateSaveLocation=$work/ctld
SlurmdSpoolDir=$work/d
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
# Without rights to control groups, and without a database.
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SchedulerParameters=sched_interval=1,batch_sched_delay=1
MinJobAge=3600
MailProg=/bin/true
SlurmdParameters=config_overrides
NodeName=one NodeHostname=$machine NodeAddr=127.0.0.1 CPUs=4
PartitionName=all Nodes=one Default=YES State=UP
CONF
start munged munged --foreground --key-file="$work/munge.key" --socket="$work/munge.socket" --pid-file="$work/munge.pid" \
  --log-file="$work/munge.log" --seed-file="$work/munge.seed" --num-threads=2
until_true 60 test -S "$work/munge.socket" || { cp "$work/munged.out" "$work/said"; fails "munged does not start"; }
start slurmctld slurmctld -D -f "$SLURM_CONF"
start slurmd slurmd -D -N one -f "$SLURM_CONF"
idle() { [[ $(sinfo -h -o %T) == idle ]]; }
until_true 120 idle || { tail -n 20 "$work"/slurm*.out >"$work/said"; fails "Slurm does not start"; }
passes "Slurm $(sinfo --version | cut -d ' ' -f 2) of one machine"

submit() { toolchain/cluster/submit.sh "$@"; }
state() { scontrol show job "$1" 2>/dev/null | sed -n 's/.*JobState=\([A-Z_]*\).*/\1/p' | sort -u | tr '\n' ' '; }
over_with() { [[ ! $(state "$1") =~ PENDING|RUNNING|COMPLETING|CONFIGURING ]]; }
# ends JOB STATE WHAT
ends() {
  until_true 300 over_with "$1" || fails "$3: still $(state "$1")"
  is "$3" "$2 " "$(state "$1")"
}

# ---- A dataset: the bytes of the single run, however many shards.
options=(--seed 5 --repeats 1 --objects ball,box --kinds static,slip)
"$HOLDFAST" dataset "${options[@]}" --out "$work/single.csv" >"$work/said" 2>&1 || fails "the single run"
for shards in 1 2 4; do
  job=$(submit "$shards" "$work/shared/$shards.csv" dataset "${options[@]}" 2>"$work/said") || fails "submit.sh $shards"
  ends "$job" COMPLETED "the merge of $shards"
  is "$shards shards' bytes" "$(sha256sum <"$work/single.csv")" "$(sha256sum <"$work/shared/$shards.csv")"
done
is "pieces that are not of the whole's size" yes "$([[ $(wc -c <"$work/shared/4.csv.pieces/part_00001") -lt $(wc -c <"$work/single.csv") ]] && echo yes)"

# ---- A lost piece is computed again, and only that one.
stamp() { stat -c '%n %i %y' "$work/shared/4.csv.pieces/"part_0000[134]; }
before=$(stamp)
rm "$work/shared/4.csv.pieces/part_00002" "$work/shared/4.csv"
job=$(submit 4 "$work/shared/4.csv" dataset "${options[@]}" 2>"$work/said") || fails "submit.sh again"
ends "$job" COMPLETED "the merge after a piece was lost"
is "its bytes" "$(sha256sum <"$work/single.csv")" "$(sha256sum <"$work/shared/4.csv")"
is "the pieces that were there" "$before" "$(stamp)"

# ---- A shard that fails: nothing is merged, and the merge does not wait for ever.
cat >"$work/failing" <<'FAILING'
#!/bin/sh
[ "$SLURM_ARRAY_TASK_ID" != 2 ] || exit 1
exec "$REAL" "$@"
FAILING
chmod +x "$work/failing"
export REAL=$HOLDFAST
job=$(HOLDFAST=$work/failing submit 2 "$work/shared/failed.csv" dataset "${options[@]}" 2>"$work/said") || fails "submit.sh of a failing tool"
until_true 300 over_with "$job" || fails "the merge waits for ever: $(state "$job")"
is "what was merged of it" "" "$(ls "$work/shared/failed.csv" 2>/dev/null || true)"
job=$(HOLDFAST=$work/failing submit 1 "$work/shared/well.csv" dataset "${options[@]}" 2>"$work/said") || fails "submit.sh of one shard"
ends "$job" COMPLETED "a run by the same tool that does not fail"

# ---- What it does not take.
refuses "another run over the same pieces" "pieces of another run" submit 4 "$work/shared/4.csv" dataset --seed 99
refuses "a command without shards" "cannot be split" submit 2 "$work/x" train "$work/single.csv"
refuses "a file that the script names" "for a whole run" submit 2 "$work/x" dataset --out y
refuses "no number" "no number of shards" submit many "$work/x" dataset
is "jobs that are left" "" "$(squeue -h)"
echo "$passed passed"
