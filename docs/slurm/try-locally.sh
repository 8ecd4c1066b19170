#!/usr/bin/env bash
# Runs a Slurm cluster of this one machine, renders a scene on it with array.sbatch, requeues one task and lets another
# run into its time limit, merges, and compares with a single run, bit by bit. Needs Debian or its kin, and root or sudo
# if Slurm is not installed. CAUSTICA names the program; without it, it is built.
set -euo pipefail
cd "$(dirname "$0")/../.."

tasks=4
passes=24
scene="$PWD/scenes/cornell-spheres.xml"
options=(--size 64x64 --aovs)

say() {
    printf '== %s\n' "$*" >&2
}

if ! command -v slurmctld >/dev/null || ! command -v slurmd >/dev/null || ! command -v munged >/dev/null; then
    say "installing Slurm"
    as_root=()
    [[ "$(id -u)" -eq 0 ]] || as_root=(sudo)
    "${as_root[@]}" apt-get update -qq
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends slurm-wlm munge
fi

if [[ -z "${CAUSTICA:-}" ]]; then
    cargo build --release --locked
    CAUSTICA="${CARGO_TARGET_DIR:-$PWD/target}/release/caustica"
fi
PATH="$(dirname "$(realpath "$CAUSTICA")"):$PATH:/usr/sbin"

# munged insists on a directory that everybody can enter and nobody else can write to.
dir="$(mktemp -d)"
chmod 755 "$dir"
daemons=()
job=""
stop() {
    # Tasks outlive the daemons. $job is set once SLURM_CONF names our own cluster.
    if [[ -n "$job" && -n "$(squeue -h)" ]]; then
        scancel "$job" || true
        sleep 8
    fi
    for pid in "${daemons[@]}"; do
        kill "$pid" 2>/dev/null || true
    done
    wait
    rm -rf "$dir"
}
trap stop EXIT

say "starting munged, slurmctld and slurmd in $dir"
host="$(hostname -s)"
user="$(id -un)"
mkdir "$dir/state" "$dir/spool"
head -c 1024 /dev/urandom >"$dir/munge.key"
chmod 600 "$dir/munge.key"
# Neither systemd nor cgroups are needed. A short cred_expire shortens the pause before a requeued task starts again.
cat >"$dir/slurm.conf" <<CONF
ClusterName=try
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=26817
SlurmdPort=26818
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
AuthInfo=socket=$dir/munge.socket,cred_expire=12
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd.pid
SlurmctldLogFile=$dir/slurmctld.log
SlurmdLogFile=$dir/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
KillWait=5
SchedulerParameters=sched_interval=5,batch_sched_delay=1
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
CONF
export SLURM_CONF="$dir/slurm.conf"
munged --foreground --key-file="$dir/munge.key" --socket="$dir/munge.socket" --pid-file="$dir/munged.pid" \
    --log-file="$dir/munged.log" --seed-file="$dir/munged.seed" 2>"$dir/munged.err" &
daemons+=($!)
until [[ -S "$dir/munge.socket" ]]; do
    kill -0 "${daemons[0]}" || { cat "$dir/munged.err" "$dir/munged.log" >&2; exit 1; }
    sleep 0.2
done
slurmctld -D 2>/dev/null &
daemons+=($!)
slurmd -D -N "$host" 2>/dev/null &
daemons+=($!)
for _ in {1..60}; do
    [[ "$(sinfo -h -o %t 2>/dev/null || true)" == idle ]] && break
    sleep 0.5
done
if [[ "$(sinfo -h -o %t)" != idle ]]; then
    tail -n 20 "$dir"/*.log >&2
    exit 1
fi
sinfo >&2

work="$dir/work"
mkdir "$work"
cd "$work"
say "submitting $tasks tasks of $passes passes, and the merge behind them"
array="$OLDPWD/docs/slurm/array.sbatch"
job="$(sbatch --parsable --array="0-$((tasks - 1))" "$array" \
    "$scene" "$passes" parts "${options[@]}" --checkpoint-interval 0.2)"
sbatch --parsable --dependency="afterok:$job" --kill-on-invalid-dep=yes --output=merge.log \
    --wrap "caustica merge parts/*.part -o merged.part && caustica merge merged.part -o out.exr" >/dev/null
squeue >&2

# What a node failure or a preemption would do, and what comes two minutes before the time limit.
wait_for_part() {
    until compgen -G "parts/$1-*.part" >/dev/null; do
        sleep 0.1
    done
}
wait_for_part 000000
say "requeueing task 0 in the midst of it"
scontrol requeue "${job}_0"
wait_for_part "$(printf '%06d' "$passes")"
say "telling task 1 that its time is nearly up"
id="$(squeue -h -r -o '%i %A' | sed -n "s/^${job}_1 //p")"
# It may try again although the signal got through, and complain in the end.
scancel --batch --signal=USR1 "$id" || true

say "waiting"
for _ in {1..600}; do
    [[ -n "$(squeue -h -o %i)" ]] || break
    sleep 0.5
done
squeue >&2
tail -n +1 -- *.log >&2
[[ -e out.exr ]] || { tail -n 40 "$dir/slurmctld.log" "$dir/slurmd.log" >&2; exit 1; }

for task in 0 1; do
    grep -q ', interrupted' "caustica-${job}_$task.log" || { say "task $task was not interrupted"; exit 1; }
done

say "the same in a single run"
mkdir single
caustica render "$scene" --passes "$((tasks * passes))" "${options[@]}" -q -o single/run.exr --checkpoint single/merged.part
# Files of one name in two directories, so that the images' attributes are equal, too.
(cd single && caustica merge merged.part -o out.exr)
caustica compare out.exr single/run.exr
cmp out.exr single/out.exr
say "equal in every byte of every layer"
