#!/usr/bin/env bash
# Makes of this one Debian host a Slurm cluster, so that job arrays can be tried and tested: installs slurm-wlm and
# munge, writes a small /etc/slurm/slurm.conf, and starts munged, slurmctld and slurmd without systemd and without
# control groups. A configuration that this script did not write is left alone: a real cluster's host is not touched.
#
#   scripts/slurm_local.sh          installs, configures and starts what isn't there; again, it changes nothing
#   scripts/slurm_local.sh stop     ends slurmd, slurmctld, and munged if this script started it
set -euo pipefail

packages=(slurm-wlm munge)
# The first line of a configuration that this script may write anew.
mark="# Written by mamf's scripts/slurm_local.sh."
conf=/etc/slurm/slurm.conf
state=/var/lib/mamf-slurm
patience=60 # seconds for the node to become idle

say() { echo "slurm_local.sh: $*"; }
fail() {
    echo "slurm_local.sh: $*" >&2
    exit 1
}

case "${1:-}" in
    "" | stop) ;;
    *)
        echo "slurm_local.sh: unknown word $1; the only one is stop" >&2
        exit 2
        ;;
esac

as_root=()
if ((EUID != 0)); then
    command -v sudo >/dev/null || fail "run this as root, or install sudo"
    as_root=(sudo)
fi

ours() { [[ -e $conf ]] && grep -qxF "$mark" "$conf"; }
# Whether a daemon that this script started still runs.
runs() {
    local pid
    pid=$("${as_root[@]}" cat "$state/$1/pid" 2>/dev/null) || return 1
    [[ $(tr '\0' ' ' 2>/dev/null <"/proc/$pid/cmdline") == *"$1"* ]]
}
# Ends a daemon that this script started.
end() {
    runs "$1" || return 0
    "${as_root[@]}" kill "$("${as_root[@]}" cat "$state/$1/pid")"
    for ((i = 0; i < 100; i++)); do
        runs "$1" || break
        sleep 0.1
    done
    say "$1 ended"
}
# The last lines of a daemon's log.
log() { "${as_root[@]}" tail -n 5 "$state/$1/log" >&2 || true; }

if [[ ${1:-} == stop ]]; then
    ours || fail "$conf is not the one that this script writes; nothing is stopped"
    for daemon in slurmd slurmctld munged; do end "$daemon"; done
    exit 0
fi

if ! ours; then
    for other in "$conf" /etc/slurm-llnl/slurm.conf ${SLURM_CONF:+"$SLURM_CONF"}; do
        [[ ! -e $other ]] || fail "$other is there already, and not from this script; nothing is changed"
    done
    # A cluster may keep its configuration elsewhere, or hand it out over the network.
    if pgrep -x slurmd >/dev/null 2>&1 || pgrep -x slurmctld >/dev/null 2>&1 || timeout 10 sinfo >/dev/null 2>&1; then
        fail "this host belongs to a cluster already; nothing is changed"
    fi
fi
if ! command -v dpkg >/dev/null || ! command -v apt-get >/dev/null; then
    fail "this is no Debian system; install Slurm yourself"
fi

missing=()
for package in "${packages[@]}"; do
    # Captured first: with pipefail, `dpkg -s | grep -q` can fail although the line is there.
    status=$(dpkg -s "$package" 2>/dev/null || true)
    grep -q '^Status: install ok installed' <<<"$status" || missing+=("$package")
done
if ((${#missing[@]} > 0)); then
    say "installing ${missing[*]}"
    "${as_root[@]}" apt-get update
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends "${missing[@]}"
fi

host=$(hostname -s)
# Some memory is left to the system; Slurm takes a node out of service that has less than its configuration says.
memory=$(awk '/^MemTotal:/ { print int($2 / 1024 * 0.9) }' /proc/meminfo)
wanted="$mark
ClusterName=mamf
SlurmctldHost=$host(127.0.0.1)
SlurmUser=slurm
AuthType=auth/munge
# A requeued job waits as long as a credential lives, 120 seconds by default.
AuthInfo=cred_expire=5
# No control groups, and no systemd to make them.
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
# Looks for jobs to start every few seconds instead of every minute.
SchedulerParameters=sched_interval=5,bf_interval=5
JobRequeue=1
# Seconds between SIGTERM and SIGKILL.
KillWait=10
# A node is taken back after a restart of the host.
ReturnToService=2
StateSaveLocation=$state/slurmctld
SlurmdSpoolDir=$state/slurmd
SlurmctldPidFile=$state/slurmctld/pid
SlurmdPidFile=$state/slurmd/pid
SlurmctldLogFile=$state/slurmctld/log
SlurmdLogFile=$state/slurmd/log
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$memory State=UNKNOWN
PartitionName=local Nodes=$host Default=YES MaxTime=INFINITE State=UP"
if [[ $(cat "$conf" 2>/dev/null || true) != "$wanted" ]]; then
    # Daemons of a host that has changed since, in name or size.
    for daemon in slurmd slurmctld; do end "$daemon"; done
    "${as_root[@]}" mkdir -p "$(dirname "$conf")"
    "${as_root[@]}" tee "$conf" >/dev/null <<<"$wanted"
    say "wrote $conf: the host $host, $(nproc) CPUs, $memory MB"
fi

# Each daemon writes to a folder of its own; munged refuses one that others own.
"${as_root[@]}" install -d -o root -g root "$state" "$state/slurmd"
"${as_root[@]}" install -d -o slurm -g slurm "$state/slurmctld"
"${as_root[@]}" install -d -o munge -g munge "$state/munged"

if ! "${as_root[@]}" test -e /etc/munge/munge.key; then
    "${as_root[@]}" install -d -o munge -g munge -m 700 /etc/munge
    "${as_root[@]}" sh -c 'umask 077; head -c 1024 /dev/urandom >/etc/munge/munge.key; chown munge: /etc/munge/munge.key'
    say "made a key for munge"
fi
if munge -n </dev/null 2>/dev/null | unmunge >/dev/null 2>&1; then
    say "munged runs already"
else
    # Debian leaves the making of these to systemd.
    "${as_root[@]}" install -d -o munge -g munge -m 755 /run/munge
    "${as_root[@]}" install -d -o munge -g munge -m 700 /var/log/munge /var/lib/munge
    "${as_root[@]}" setpriv --reuid munge --regid munge --clear-groups munged --pid-file "$state/munged/pid"
    say "started munged"
fi

for daemon in slurmctld slurmd; do
    if runs "$daemon"; then
        say "$daemon runs already"
    else
        "${as_root[@]}" "$daemon" || { log "$daemon"; fail "$daemon does not start; see $state/$daemon/log"; }
        say "started $daemon"
    fi
done

for ((i = 0; i < patience; i++)); do
    node=$(sinfo --noheader --Node --nodes "$host" --format %t 2>/dev/null || true)
    case "$node" in
        idle | mix | alloc)
            say "the node $host is ready ($node): sinfo, sbatch and squeue work now"
            exit 0
            ;;
        # Left from a node that was lost; it is the same host, and works.
        down* | drain*) "${as_root[@]}" scontrol update nodename="$host" state=resume 2>/dev/null || true ;;
    esac
    sleep 1
done
log slurmctld
log slurmd
fail "the node $host is not ready after $patience seconds: ${node:-no answer}"
