#!/bin/sh
# A SLURM of one node on this machine, with authentication of its own and without accounting, for tests.
#
#   benchmarks/cluster/start_slurm.sh FOLDER [CPUS]    start; print the line that points commands at it: export ...
#   benchmarks/cluster/start_slurm.sh FOLDER stop      stop what was started from FOLDER
#
# Debian and Ubuntu: installs what is missing where it runs as root. Any user may run it once slurmctld, slurmd, slurm-client and
# munge are installed; jobs then run as that user. It touches no other SLURM of the machine: sockets, ports and state are its own.
set -eu

usage="usage: $0 FOLDER [CPUS | stop]"
FOLDER=${1:?$usage}
CPUS=${2:-$(nproc)}
PATH=$PATH:/usr/sbin:/sbin

die() { echo "start_slurm.sh: $*" >&2; exit 1; }

stop() { # SIGTERM, and SIGKILL for what does not end within 10 s
    for daemon in slurmd slurmctld munged; do
        [ -s "$FOLDER/$daemon.pid" ] || continue
        pid=$(cat "$FOLDER/$daemon.pid")
        kill "$pid" 2>/dev/null || continue
        for _ in $(seq 100); do kill -0 "$pid" 2>/dev/null || break; sleep 0.1; done
        kill -9 "$pid" 2>/dev/null || true
    done
}

if [ "$CPUS" = stop ]; then stop; exit 0; fi
case $CPUS in *[!0-9]* | '' | 0) die "CPUS is \"$CPUS\", a whole number from 1 on is needed. $usage" ;; esac

missing=
for program in slurmctld slurmd sbatch munged; do
    command -v $program >/dev/null || missing="$missing $program"
done
if [ -n "$missing" ]; then
    packages="slurmctld slurmd slurm-client munge"
    command -v apt-get >/dev/null || die "not installed:$missing; install SLURM and munge (Debian's packages: $packages)"
    [ "$(id -u)" = 0 ] || die "not installed:$missing; sudo apt-get install --yes $packages"
    apt-get update >&2 && DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends $packages >&2 ||
        die "not installed:$missing, and apt-get could not install $packages: see above"
fi

mkdir -p "$FOLDER"
FOLDER=$(cd "$FOLDER" && pwd)
if [ -s "$FOLDER/slurmctld.pid" ] && kill -0 "$(cat "$FOLDER/slurmctld.pid")" 2>/dev/null; then
    die "one runs from $FOLDER already; $0 $FOLDER stop"
fi
rm -rf "${FOLDER:?}"/state "$FOLDER"/spool "$FOLDER"/*.pid
mkdir -m 700 "$FOLDER/state" "$FOLDER/spool"

# Memory is watched by reading /proc, since a container seldom may make control groups; a job over its limit is killed.
user=$(id -un)
port=$((20000 + 2 * ($$ % 6000))) # several may run beside each other
node=$(hostname -s)
memory=$(awk '/^MemTotal/ {print int($2 / 1024 * 0.9)}' /proc/meminfo)
[ -s "$FOLDER/munge.key" ] || (umask 077 && head -c 128 /dev/urandom >"$FOLDER/munge.key")
cat >"$FOLDER/slurm.conf" <<END
ClusterName=lumbar
SlurmctldHost=$node(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
CryptoType=crypto/munge
AuthInfo=socket=$FOLDER/munge.socket
StateSaveLocation=$FOLDER/state
SlurmdSpoolDir=$FOLDER/spool
SlurmctldPidFile=$FOLDER/slurmctld.pid
SlurmdPidFile=$FOLDER/slurmd.pid
SlurmctldLogFile=$FOLDER/slurmctld.log
SlurmdLogFile=$FOLDER/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=2
JobAcctGatherParams=OverMemoryKill,UsePss
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
MpiDefault=none
ReturnToService=2
SlurmdParameters=config_overrides
KillWait=5
MinJobAge=600
NodeName=$node NodeAddr=127.0.0.1 CPUs=$CPUS RealMemory=$memory State=UNKNOWN
PartitionName=all Nodes=$node Default=YES MaxTime=INFINITE DefMemPerCPU=1000 State=UP
END
# Nothing here uses control groups, but slurmd loads a plugin for them: from 23.02 on it may be told to do without; before, that of
# version 1 is the one that looks for no mounted file system until it is used.
case $(slurmd -V) in
    "slurm-wlm "2[0-2].* | "slurm "2[0-2].*) echo "CgroupPlugin=cgroup/v1" >"$FOLDER/cgroup.conf" ;;
    *) echo "CgroupPlugin=disabled" >"$FOLDER/cgroup.conf" ;;
esac
export SLURM_CONF="$FOLDER/slurm.conf"
# Snakemake's plugin calls srun without SLURM_CONF: right where slurm.conf lies in /etc/slurm, which is not ours to write.
mkdir -p "$FOLDER/bin"
printf '#!/bin/sh\nexec env SLURM_CONF="%s" "%s" "$@"\n' "$SLURM_CONF" "$(command -v srun)" >"$FOLDER/bin/srun"
chmod +x "$FOLDER/bin/srun"

started() { [ -s "$FOLDER/$1.pid" ] && kill -0 "$(cat "$FOLDER/$1.pid")" 2>/dev/null; }
start() {
    name=$1; shift
    "$@" >&2 || { tail -n 20 "$FOLDER/$name.log" >&2 || true; stop; die "$name did not start: see above"; }
    for _ in $(seq 50); do started "$name" && return; sleep 0.1; done
    tail -n 20 "$FOLDER/$name.log" >&2 || true; stop; die "$name does not run: see above, and $FOLDER/$name.log"
}

# Forced: munged doubts folders below ones that others may write to, such as /tmp.
start munged munged --force --key-file="$FOLDER/munge.key" --socket="$FOLDER/munge.socket" --pid-file="$FOLDER/munged.pid" \
    --log-file="$FOLDER/munged.log" --seed-file="$FOLDER/munge.seed"
start slurmctld slurmctld -f "$SLURM_CONF"
start slurmd slurmd -f "$SLURM_CONF"
for _ in $(seq 150); do
    if [ "$(sinfo --noheader --format=%T 2>/dev/null)" = idle ]; then
        echo "export SLURM_CONF=$SLURM_CONF PATH=$FOLDER/bin:\$PATH"
        exit 0
    fi
    sleep 0.2
done
sinfo >&2 || true
tail -n 20 "$FOLDER/slurmctld.log" "$FOLDER/slurmd.log" >&2
stop
die "the node did not become idle within 30 s: see above"
