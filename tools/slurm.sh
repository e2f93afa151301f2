#!/usr/bin/env bash
# A Slurm of one node on this machine, for trying and testing what is meant for a cluster.
#
#   tools/slurm.sh start [DIR]   starts it; everything it writes goes to DIR (default: runs/slurm)
#   tools/slurm.sh stop [DIR]    stops it
#
# Needs root and Debian's packages slurm-wlm and munge. Clients find it by SLURM_CONF=DIR/slurm.conf,
# which `start` prints as a line for the shell:  eval "$(tools/slurm.sh start)"
set -euo pipefail

usage() { sed -n '2,8s/^# \{0,1\}//p' "$0" >&2; exit 2; }
[ $# -ge 1 ] && [ $# -le 2 ] || usage
folder=$(realpath -m "${2:-$(dirname "$0")/../runs/slurm}")

write_config() {
  local host memory port
  host=$(hostname -s)
  port=$((20000 + RANDOM % 20000)) # so that several can run at once
  memory=$(awk '/^MemTotal/ {print int($2 / 1024 * 0.9)}' /proc/meminfo)
  cat > "$folder/slurm.conf" <<CONF
ClusterName=one-node
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=2,bf_interval=2,requeue_delay=0
ReturnToService=2
KillWait=5
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$memory State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
}

# whether the process in a pid file runs
runs() { [ -s "$folder/$1.pid" ] && kill -0 "$(cat "$folder/$1.pid" 2> /dev/null)" 2> /dev/null; }

start() {
  for program in munged slurmctld slurmd sinfo; do
    command -v "$program" > /dev/null ||
      { echo "$program is missing; on Debian: apt-get install slurm-wlm munge" >&2; exit 2; }
  done
  [ "$(id -u)" = 0 ] || { echo "the daemons need root" >&2; exit 2; }
  ! runs slurmctld || { echo "already runs in $folder" >&2; exit 2; }
  mkdir -p "$folder/state" "$folder/spool"
  chmod 755 "$folder"
  (umask 077 && head -c 1024 /dev/urandom > "$folder/munge.key")
  write_config
  export SLURM_CONF=$folder/slurm.conf
  munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" \
    --pid-file="$folder/munge.pid" --log-file="$folder/munge.log" \
    --seed-file="$folder/munge.seed" > "$folder/munge.out" 2>&1
  slurmctld -c > "$folder/slurmctld.out" 2>&1
  slurmd -c > "$folder/slurmd.out" 2>&1
  for _ in $(seq 60); do
    if sinfo --noheader --format %t 2> /dev/null | grep -q '^idle'; then
      echo "export SLURM_CONF=$SLURM_CONF"
      return
    fi
    sleep 0.5
  done
  tail -n 5 "$folder"/*.log >&2
  stop
  exit 1
}

stop() {
  local name
  if runs slurmctld; then
    export SLURM_CONF=$folder/slurm.conf
    scancel --me || true
    for _ in $(seq 60); do
      [ -n "$(squeue --me --noheader 2> /dev/null)" ] || break
      sleep 0.5
    done
  fi
  for name in slurmd slurmctld munge; do
    if runs "$name"; then
      kill "$(cat "$folder/$name.pid")"
      while runs "$name"; do sleep 0.1; done
    fi
    rm -f "$folder/$name.pid"
  done
}

case $1 in
  start) start ;;
  stop) stop ;;
  *) usage ;;
esac
