# SPDX-License-Identifier: Apache-2.0
"""Batches on a Slurm cluster: a job for each plant, through submitit (extra `[slurm]`).

A job saves the outcome in the plant's folder, beside its log, so that anybody who sees the folder can read it; the
program never reads anything that a job pickled. If the time limit or another user's job ends a job, it is queued again
and continues with the stage that it was in.
"""

from __future__ import annotations

import getpass
import re
import shutil
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from .batch import RUN, Batch, Result, result_of, saved_results
from .choices import Asked, choose
from .core.runs import State
from .errors import BadInput, BadUsage, Cotton3dgError, EnvironmentUnusable
from .field.tables import TABLE
from .io.saving import explain_disk_errors
from .pipeline import status as plant_status
from .schemas.batch import Jobs, PlantOutcome
from .workspace import Workspace

JOBS_FOLDER: Final = ".slurm"
"""Folder below the batch's: the scripts of the jobs, their own output, and which job works on which plant."""
JOBS: Final = f"{JOBS_FOLDER}/jobs.json"
LOG: Final = "slurm.log"
OUTCOME: Final = "records/batch.json"
"""Path of the outcome in the plant's folder."""

DEFAULTS: Final[dict[str, Any]] = {"time": 120, "cpus_per_task": 2, "mem": "4G"}
"""Settings with sbatch's names, time in minutes: several times the time of a plant at the standard preset. A job that
needs longer is queued again."""
MOST_TIMEOUTS: Final = 10
MAX_ARRAY_SIZE: Final = 1001
"""Slurm's default, for a cluster that does not say."""


class PlantJob:
    """The work of a job, in the form that submitit pickles."""

    def __init__(self, folder: Path, arguments: Sequence[str], retries: int, command: Sequence[str] = RUN) -> None:
        self.folder, self.arguments, self.retries, self.command = folder, list(arguments), retries, list(command)
        self.process: subprocess.Popen[bytes] | None = None

    def __call__(self, name: str) -> None:
        """Run a plant, again after a fault of the machine, and save the outcome."""
        (self.folder / name / OUTCOME).unlink(missing_ok=True)
        for attempt in range(self.retries + 1):
            result = self._attempt(name)
            if attempt == self.retries or not result.worth_retrying:
                break
        with explain_disk_errors(self.folder / name):
            outcome = PlantOutcome(result.folder, result.state, result.exit_code, result.reason)
            outcome.save(self.folder / name / OUTCOME)

    def _attempt(self, name: str) -> Result:
        plant = self.folder / name
        with (plant / LOG).open("a+b") as log:
            start = log.tell()
            self.process = subprocess.Popen(
                [*self.command, str(plant), "--wait", *self.arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                preexec_fn=_deaf_to_the_time_limit,  # noqa: PLW1509 - a job has one thread
            )
            code = self.process.wait()
            log.seek(start)
            return result_of(name, code, log.read().decode("utf-8", "replace"))

    def checkpoint(self, name: str) -> Any:
        """submitit calls it before the time limit, or when another job takes the place; returns what to queue again."""
        from submitit.helpers import DelayedSubmission

        if self.process:
            self.process.kill()  # the saved results of its stages are whole at any moment
        return DelayedSubmission(PlantJob(self.folder, self.arguments, self.retries, self.command), name)


def _deaf_to_the_time_limit() -> None:
    """Ignore Slurm's warning: it goes to all processes of a job, and the parent of this one answers it."""
    signal.signal(signal.SIGUSR2, signal.SIG_IGN)


def slurm_executor(folder: Path, settings: Sequence[str]) -> Any:
    """submitit's executor.

    Args:
        settings: KEY=VALUE with sbatch's names, time in minutes: partition=short, time=60, mem=8G, account=cotton.
    Raises:
        EnvironmentUnusable: no submitit, or no Slurm.
        BadUsage: a setting does not exist.
    """
    try:
        import submitit
    except ImportError as error:
        raise EnvironmentUnusable("submitit is missing; pip install 'cotton3dg[slurm]'") from error
    if shutil.which("sbatch") is None:
        raise EnvironmentUnusable("sbatch is not on the PATH; start the batch where jobs are submitted from")
    values = DEFAULTS | dict(_setting(text) for text in settings)
    executor = submitit.SlurmExecutor(folder / JOBS_FOLDER / "%j", max_num_timeout=MOST_TIMEOUTS)
    try:
        executor.update_parameters(
            **{"job_name": "cotton3dg", "stderr_to_stdout": True, "additional_parameters": {"requeue": True}},
            # Steps do not inherit the cores of their job since Slurm 22.05.
            **{"srun_args": [f"--cpus-per-task={values['cpus_per_task']}"]},
            **values,
        )
    except (TypeError, ValueError) as error:
        raise BadUsage(f"--slurm: {str(error).splitlines()[0]}; give options of sbatch") from error
    return executor


def _setting(text: str) -> tuple[str, int | float | str]:
    key, equals, value = text.partition("=")
    if not (key and equals and value):
        raise BadUsage(f"--slurm {text}: write KEY=VALUE, e.g. partition=short")
    for kind in (int, float):
        try:
            return key.replace("-", "_"), kind(value)
        except ValueError:
            continue
    return key.replace("-", "_"), value


def max_array_size() -> int:
    """Largest number of jobs in one array on this cluster."""
    output = _output_of("scontrol", "show", "config")
    found = re.search(r"^MaxArraySize\s*=\s*(\d+)", output, re.MULTILINE)
    return max(1, int(found[1]) if found else MAX_ARRAY_SIZE)


def submit(batch: Batch, plants: Sequence[Path], executor: Any, array_size: int) -> dict[str, str]:
    """Submit the plants that no job works on, in arrays of at most `array_size`; return the jobs by plant."""
    batch.check_plants()
    jobs = _jobs(batch.folder)
    waiting = _queued(jobs.values()) if jobs else {}
    names = [plant.relative_to(batch.folder).as_posix() for plant in plants]
    names = [name for name in names if jobs.get(name) not in waiting]
    work = PlantJob(batch.folder.resolve(), batch.arguments, batch.retries, batch.command)
    submitted: dict[str, str] = {}
    for start in range(0, len(names), array_size):
        part = names[start : start + array_size]
        submitted |= {name: job.job_id for name, job in zip(part, executor.map_array(work, part), strict=True)}
        with explain_disk_errors(batch.folder):
            Jobs(jobs | submitted).save(batch.folder / JOBS)
    return submitted


def status(batch: Batch, plants: Sequence[Path], asked: Asked | None = None) -> list[Result]:
    """The present results of the plants, with their options and files as they are now.

    The function saves the tables again if there are jobs; else it leaves them as the batch wrote them.
    """
    jobs = _jobs(batch.folder)
    waiting = _queued(jobs.values()) if jobs else {}
    names = [plant.relative_to(batch.folder).as_posix() for plant in plants]
    if jobs:
        batch.results |= {name: _result(batch.folder, name, jobs.get(name), waiting) for name in names}
        batch.check_plants()
        batch.save()
    else:
        saved = saved_results(batch.folder) if (batch.folder / TABLE).is_file() else {}
        batch.results = {name: Result(name) for name in names} | saved
    for name in names:
        if jobs.get(name) not in waiting:
            batch.results[name] = _as_it_stands(batch.folder, batch.results[name], asked)
    return batch.ordered()


def _as_it_stands(folder: Path, result: Result, asked: Asked | None) -> Result:
    """The result that `status` shows: a finished plant may have become stale, another may have finished since."""
    try:
        workspace = Workspace(folder / result.folder)
        states = plant_status(workspace, choose(workspace, asked).options)
    except Cotton3dgError as error:
        return Result(result.folder, State.FAILED, error.exit_code, str(error))
    due = [item for item in states if not item.done]
    if not due:
        return Result(result.folder, State.DONE, 0)
    if result.state == State.FAILED or result.reason:
        return result
    return Result(result.folder, due[0].state, None, f"{due[0].stage}: {due[0].reason}")


def _result(folder: Path, name: str, job: str | None, waiting: dict[str, str]) -> Result:
    if job is None:
        return Result(name, State.WAITING, None, "not submitted")
    if job in waiting:
        return Result(name, State.WAITING, None, f"job {job} is {waiting[job].lower()}")
    try:
        saved = PlantOutcome.load(folder / name / OUTCOME)
        return Result(name, State(saved.state), saved.exit_code, saved.reason)
    except (BadInput, ValueError):
        reason = f"job {job} ended without a word; submit again to go on, or see its {LOG}"
        return Result(name, State.FAILED, None, reason)


def _jobs(folder: Path) -> dict[str, str]:
    try:
        return Jobs.load(folder / JOBS).of_plants
    except BadInput:
        return {}


def _queued(jobs: Any) -> dict[str, str]:
    """State of the jobs among `jobs` that wait or run."""
    output = _output_of("squeue", "--noheader", "--array", "--user", getpass.getuser(), "--format", "%i %T")
    found = dict(line.split(maxsplit=1) for line in output.splitlines() if " " in line.strip())
    return {job: found[job].strip() for job in jobs if job in found}


def _output_of(*command: str) -> str:
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True, errors="replace").stdout
    except (OSError, subprocess.CalledProcessError) as error:
        reason = getattr(error, "stderr", "") or str(error)
        raise EnvironmentUnusable(
            f"{command[0]} fails ({reason.strip().splitlines()[-1]}); start it where Slurm's commands work"
        ) from error
