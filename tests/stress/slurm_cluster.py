# SPDX-License-Identifier: Apache-2.0
"""Four small plants through a real Slurm of one node on the loopback: `make slurm-test` (as root).

    python tests/stress/slurm_cluster.py /tmp/slurm_test

Starts munge, slurmctld and slurmd with files of their own below the folder, and stops them at the end. The run of one
plant is killed, the job of another is put back into the queue in the middle (as when its node is lost), and a third
one's job meets its time limit again and again; all four have to end with the rows that `cotton3dg run` gives.
"""

from __future__ import annotations

import argparse
import csv
import os
import pwd
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "hard_cases"))

from killed_runs import SMALL, film_room

CONFIG = """
ClusterName=cotton
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort=36817
SlurmdPort=36818
AuthType=auth/munge
AuthInfo=socket={root}/munge.socket
SlurmUser=root
SlurmdUser=root
StateSaveLocation={root}/state
SlurmdSpoolDir={root}/spool
SlurmctldPidFile={root}/slurmctld.pid
SlurmdPidFile={root}/slurmd.pid
SlurmctldLogFile={root}/slurmctld.log
SlurmdLogFile={root}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MailProg=/bin/true
MpiDefault=none
ReturnToService=2
MaxArraySize=3
KillWait=5
OverTimeLimit=0
SchedulerParameters=requeue_delay=1,bf_interval=2,sched_interval=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} State=UNKNOWN
PartitionName=plants Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""
PLANTS = ("p1_plain", "p2_killed", "p3_requeued", "p4_broken")


def until(condition: Callable[[], object], what: str, limit_s: float = 600) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, f"not in {limit_s:.0f} s: {what}"
        time.sleep(0.5)


@contextmanager
def cluster(root: Path) -> Iterator[None]:
    """A Slurm of one node; stopped at the end, by pid."""
    for name in ("state", "spool"):
        (root / name).mkdir(parents=True)
    host = subprocess.run(["hostname", "-s"], capture_output=True, text=True, check=True).stdout.strip()
    (root / "slurm.conf").write_text(CONFIG.format(host=host, root=root, cores=os.cpu_count()))
    (root / "munge.key").write_bytes(os.urandom(1024))
    (root / "munge.key").chmod(0o400)
    os.environ["SLURM_CONF"] = str(root / "slurm.conf")
    files = {"key-file": "munge.key", "pid-file": "munged.pid", "log-file": "munged.log", "seed-file": "munged.seed"}
    munged = ["munged", "--force", "--foreground", f"--socket={root}/munge.socket"]
    munged += [f"--{option}={root / name}" for option, name in files.items()]
    daemons: list[subprocess.Popen[bytes]] = []
    try:
        with (root / "daemons.log").open("ab") as log:
            for command in (munged, ["slurmctld", "-D", "-i"], ["slurmd", "-D"]):
                daemons.append(subprocess.Popen(command, stdout=log, stderr=log))
                time.sleep(2)
                assert daemons[-1].poll() is None, (root / "daemons.log").read_text()[-2000:]
        until(lambda: "idle" in said("sinfo", "-h", "-o", "%T"), "the node is up", 60)
        yield
    finally:
        for daemon in reversed(daemons):
            daemon.terminate()
            try:
                daemon.wait(20)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()


def said(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def batch(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    options = [word for key, value in SMALL.items() for word in ("--set", f"{key}={value}")]
    command = [sys.executable, "-m", "cotton3dg.cli", "batch", str(folder), "--no-report", *options, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def pid_of_run(plant: Path) -> int | None:
    """The process of `cotton3dg run` on a plant that has begun its first stage."""
    if not (plant / "frames").is_dir():
        return None
    for process in Path("/proc").iterdir():
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"run" in words and str(plant).encode() in words:
            return int(process.name)
    return None


def rows(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / "batch.csv").open(newline="") as file:
        return {row["folder"]: row for row in csv.DictReader(file)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    root = parser.parse_args().folder.absolute()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended"))  # so that the daemons are stopped, too
    field = root / "field"
    for name in PLANTS:
        (field / name).mkdir(parents=True)
    film_room(field / PLANTS[0] / "video.mp4")
    for name in PLANTS[1:3]:
        shutil.copyfile(field / PLANTS[0] / "video.mp4", field / name / "video.mp4")
    (field / "p4_broken" / "video.mp4").write_text("no film")
    jobs = ("--engine", "slurm", "--slurm", "cpus_per_task=1", "--slurm", "mem=0", "--slurm", "time=20")
    with cluster(root / "slurm"):
        done = batch(field, *jobs, "--retry", "1")
        assert done.returncode == 0, done.stderr
        print(done.stdout.strip(), flush=True)
        until(lambda: pid_of_run(field / "p2_killed"), "p2 runs")
        os.kill(pid_of_run(field / "p2_killed") or 0, signal.SIGKILL)
        print("p2_killed: its run got SIGKILL", flush=True)
        until(lambda: pid_of_run(field / "p3_requeued"), "p3 runs")
        batch(field, "--status")
        job = rows(field)["p3_requeued"]["reason"].split()[1]
        said("scontrol", "requeue", job)
        print(f"p3_requeued: job {job} was put back into the queue: {rows(field)['p3_requeued']['reason']}", flush=True)
        until(lambda: not said("squeue", "-h"), "all jobs end")
        done = batch(field, "--status")
        print(done.stdout.strip(), flush=True)
        found = rows(field)
        assert {name: row["state"] for name, row in found.items()} == {
            name: "failed" if name == "p4_broken" else "done" for name in PLANTS
        }
        assert found["p4_broken"]["exit_code"] == "4"
        traits = [{k: v for k, v in found[name].items() if k not in TOLD} for name in PLANTS[:3]]
        assert traits[0] == traits[1] == traits[2]
        log = (field / "p3_requeued" / "slurm.log").read_text()
        assert log.count("frames: starts") == 1 and "frames: up to date" in log, log
        timed_out(root / "late")
    print("4 plants done as they should be")


TOLD = ("folder", "plant_id", "seconds")


def timed_out(folder: Path) -> None:
    """A job whose warning comes long before it is done is queued again and goes on."""
    plant = folder / "plant"
    plant.mkdir(parents=True)
    film_room(plant / "video.mp4")
    done = batch(folder, "--engine", "slurm", "--slurm", "cpus_per_task=1", "--slurm", "mem=0", "--slurm", "time=20")
    assert done.returncode == 0, done.stderr
    until(lambda: pid_of_run(plant), "the run works")
    (job,) = said("squeue", "-h", "-o", "%A").split()
    said("scancel", "--signal=USR2", job)  # what Slurm sends 90 s before the limit
    until(lambda: not said("squeue", "-h"), "the job ends")
    assert batch(folder, "--status").returncode == 0
    log = (plant / "slurm.log").read_text()
    assert log.count("frames: starts") == 1 and "frames: up to date" in log, log
    print(f"job {job} was warned of its time limit, queued again and went on by stage")


if __name__ == "__main__":
    assert pwd.getpwuid(os.getuid()).pw_name == "root", "the daemons of Slurm are started as root"
    main()
