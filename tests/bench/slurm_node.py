"""A Slurm of one node, this machine, in a folder of its own: munged, slurmctld and slurmd of Debian's packages, started by
hand and stopped at the end. No accounting, no cgroups; a link in /etc/slurm as long as it runs.

``with running(folder) as environment:`` gives the environment in which sbatch, srun and squeue talk to it.
"""

import contextlib
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path

PROGRAMS = ("munged", "mungekey", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "sinfo", "scontrol")
STARTS_S = 60
# Where Debian's Slurm looks: the srun of a job does not get the submitter's SLURM_CONF.
DEFAULT_CONF = Path("/etc/slurm/slurm.conf")
MEMORY_SHARE = 0.9  # of the machine's memory that jobs may ask for


def missing_programs():
    """Return which of Slurm's and munge's programs are not installed."""
    return [name for name in PROGRAMS if shutil.which(name, path=search_path()) is None]


def search_path():
    """Return the search path with the folders of daemons."""
    return f"{os.environ['PATH']}:/usr/sbin:/sbin"


def free_ports(count):
    """Return TCP ports that nobody listens on now."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for s in sockets:
            s.bind(("", 0))
        return [s.getsockname()[1] for s in sockets]


def configuration(folder, host, cpus, memory_mb, ports):
    """Return slurm.conf. Jobs are given whole CPUs and the memory that they ask for: asking for too much is seen here."""
    return f"""ClusterName=twingap
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
ReturnToService=2
MinJobAge=600
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
SchedulerParameters=sched_interval=5
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory={memory_mb} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


@contextlib.contextmanager
def running(folder):
    """Start the three daemons with all their files in ``folder``; give the environment to talk to them; stop them."""
    folder = Path(folder).resolve()
    if DEFAULT_CONF.is_symlink() and not DEFAULT_CONF.exists():
        DEFAULT_CONF.unlink()  # of a run that was killed
    if DEFAULT_CONF.exists():
        raise RuntimeError(f"{DEFAULT_CONF}: this machine has a Slurm already")
    for name in ("state", "spool"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    memory_mb = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**20
    host = socket.gethostname().partition(".")[0]
    text = configuration(folder, host, os.cpu_count(), int(MEMORY_SHARE * memory_mb), free_ports(2))
    (folder / "slurm.conf").write_text(text)
    environment = os.environ | {"SLURM_CONF": str(folder / "slurm.conf"), "PATH": search_path()}
    key = folder / "munge.key"
    key.unlink(missing_ok=True)
    subprocess.run(["mungekey", "-c", "-k", str(key)], env=environment, check=True)
    files = {"key": key, "socket": "munge.socket", "pid": "munged.pid", "log": "munged.log", "seed": "munged.seed"}
    munge = [f"--{option}-file={folder / name}" for option, name in files.items() if option != "socket"]
    daemons = [
        ["munged", "-F", "--force", f"--socket={folder / 'munge.socket'}", *munge],
        ["slurmctld", "-D", "-f", str(folder / "slurm.conf")],
        ["slurmd", "-D", "-f", str(folder / "slurm.conf"), "-N", host],
    ]
    started = []
    DEFAULT_CONF.symlink_to(folder / "slurm.conf")
    try:
        for command in daemons:
            with open(folder / f"{command[0]}.out", "w") as out:
                daemon = subprocess.Popen(command, env=environment, stdout=out, stderr=out, start_new_session=True)
            started.append(daemon)
            if command[0] == "munged":
                wait_for((folder / "munge.socket").exists, daemon, folder)
        wait_for(lambda: node_state(environment) == "idle", started[-1], folder)
        yield environment
    finally:
        DEFAULT_CONF.unlink()
        for daemon in reversed(started):
            daemon.terminate()
            try:
                daemon.wait(STARTS_S)
            except subprocess.TimeoutExpired:
                daemon.kill()


def node_state(environment):
    """Return what Slurm says of the node: idle when it takes jobs."""
    said = subprocess.run(["sinfo", "-h", "-o", "%T"], env=environment, capture_output=True, text=True, check=False)
    return said.stdout.strip()


def wait_for(condition, daemon, folder):
    """Wait until a condition holds; raise RuntimeError where it does not or the daemon has ended."""
    end = time.monotonic() + STARTS_S
    while not condition():
        if daemon.poll() is not None or time.monotonic() > end:
            raise RuntimeError(f"{daemon.args[0]} did not start: see the logs in {folder}")
        time.sleep(0.2)
