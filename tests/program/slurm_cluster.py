"""A Slurm of one node that a test or a benchmark starts for itself and ends again: a munged, a slurmctld and a slurmd of its own, in a
folder and on ports of its own, without systemd. It needs Debian's packages slurm-wlm and munge, and root (slurmd starts programs for
any user).
"""

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel")
PATH = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"

CONF = """ClusterName=kincal
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthInfo=socket={dir}/munge.socket
SlurmUser=root
SlurmdUser=root
StateSaveLocation={dir}/state
SlurmdSpoolDir={dir}/spool
SlurmctldPidFile={dir}/slurmctld.pid
SlurmdPidFile={dir}/slurmd.pid
SlurmctldLogFile={dir}/slurmctld.log
SlurmdLogFile={dir}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
{epilog}
ReturnToService=2
KillWait=5
MaxArraySize=1001
NodeName=localhost NodeAddr=127.0.0.1 CPUs={cpus}
PartitionName=main Nodes=localhost Default=YES State=UP
PartitionName=closed Nodes=localhost Default=NO State=DOWN
"""


class Unavailable(Exception):
    """There is no Slurm to be had here; the text says why."""


def free_ports(count):
    """Ports that nothing listens on, at this moment."""
    sockets = [socket.socket() for _ in range(count)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return ports


class Cluster:
    """with Cluster() as cluster: subprocess.run(["sbatch", ...], env=cluster.env)"""

    def __init__(self, cpus=None, epilog=True):
        """epilog: with a program that nodes run after each task (here one that does nothing), as most clusters have. Without one, slurmd tells that
        a task which is gone before slurmctld asks for it is done in a way after which slurmctld does not look for the next one: a
        processor then waits for the scheduler's next round (batch_sched_delay, three seconds) unless that race goes the other way."""
        self.epilog = "Epilog=/bin/true" if epilog else ""
        missing = [name for name in PROGRAMS if not shutil.which(name, path=PATH)]
        if missing:
            raise Unavailable("no %s (Debian: slurm-wlm, munge)" % ", ".join(missing))
        if os.geteuid() != 0:
            raise Unavailable("a Slurm of its own needs root")
        self.cpus = cpus or len(os.sched_getaffinity(0))

    def __enter__(self):
        self.dir = tempfile.mkdtemp(prefix="kincal_slurm_")
        self.daemons = []
        try:
            self.start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def start(self):
        os.chmod(self.dir, 0o755)
        conf = os.path.join(self.dir, "slurm.conf")
        for name in ("state", "spool"):
            os.mkdir(os.path.join(self.dir, name))
        with open(conf, "w") as file:
            file.write(CONF.format(dir=self.dir, ports=free_ports(2), cpus=self.cpus, epilog=self.epilog))
        key = os.path.join(self.dir, "munge.key")
        with open(key, "wb") as file:
            file.write(os.urandom(128))
        os.chmod(key, 0o600)
        self.env = dict(os.environ, SLURM_CONF=conf, PATH=PATH)
        self.daemon("munged", "--foreground", "--force", "--key-file", key, "--socket", os.path.join(self.dir, "munge.socket"), "--pid-file",
                    os.path.join(self.dir, "munged.pid"), "--seed-file", os.path.join(self.dir, "munge.seed"), "--log-file", os.path.join(self.dir, "munged.log"))
        self.daemon("slurmctld", "-D", "-f", conf)
        self.daemon("slurmd", "-D", "-N", "localhost", "-f", conf)
        end = time.time() + 20
        while "idle" not in self.run("sinfo", "-h", "-o", "%T"):
            if time.time() > end or any(d.poll() is not None for d in self.daemons):
                raise Unavailable("Slurm does not start: " + self.logs())
            time.sleep(0.1)

    def daemon(self, *command):
        with open(os.path.join(self.dir, command[0] + ".out"), "w") as out:
            self.daemons.append(subprocess.Popen(command, env=self.env, stdin=subprocess.DEVNULL, stdout=out, stderr=out))

    def run(self, *command):
        """Standard output of one of Slurm's commands; "" if it fails."""
        return subprocess.run(command, env=self.env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, universal_newlines=True,
                              timeout=30).stdout

    def end_jobs(self):
        self.run("scancel", "--state=PENDING", "--user=root")
        self.run("scancel", "--signal=KILL", "--full", "--user=root")
        end = time.time() + 20
        while self.run("squeue", "-h") and time.time() < end:
            time.sleep(0.1)

    def logs(self):
        text = ""
        for name in sorted(os.listdir(self.dir)):
            if name.endswith((".log", ".out")):
                with open(os.path.join(self.dir, name), errors="replace") as file:
                    text += "".join("\n%s: %s" % (name, line.rstrip()) for line in file.readlines()[-5:])
        return text

    def __exit__(self, *_):
        if len(self.daemons) == 3 and all(d.poll() is None for d in self.daemons):
            self.end_jobs()
        for daemon in reversed(self.daemons):
            daemon.send_signal(signal.SIGTERM)
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        shutil.rmtree(self.dir, ignore_errors=True)
