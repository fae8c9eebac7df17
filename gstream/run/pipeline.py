"""The order of a job: each stage is planned, its missing units run, its counts summed.

Knows stages only by their three functions and executors only by `run`; which processes do the
work is the business of `local.py`.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any, Protocol

from gstream.job import Job, Summary, Unit
from gstream.run.local import MemorySampler, Workers, disk_errors, stop_on_signals
from gstream.run.progress import Progress, Silent
from gstream.run.publish import Scratch


class Stage(Protocol):
    """A module of gstream.stages; `warm()`, where it has one, compiles its kernels."""

    NAME: str
    __name__: str

    def plan(self, job: Job) -> list[Unit]: ...
    def work(self, job: Job, unit: Unit) -> None: ...
    def finish(self, job: Job) -> Summary: ...


@dataclass(frozen=True, slots=True)
class StageReport:
    """What one stage did."""

    stage: str
    seconds: float  # wall clock, without the kernels
    warm_seconds: float  # compiling or loading its kernels
    units: int
    resumed: int  # units that an earlier run had finished
    counts: Mapping[str, int | float | str]


@dataclass(frozen=True, slots=True)
class RunReport:
    """What a job did; `--report` writes it as JSON."""

    output: str
    output_bytes: int
    stages: tuple[StageReport, ...]
    warm_seconds: float  # of all stages
    seconds: float  # wall clock, all of it
    cpu_seconds: float  # user and system, of the whole process tree
    peak_memory: int  # bytes, Σ (Pss_Anon + Pss_Shmem) over the process tree
    workers: int

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON values."""
        return asdict(self)


def run_job(
    job: Job, stages: Sequence[Stage], progress: Progress | None = None, workers: int | None = None
) -> RunReport:
    """Run `stages` in order over `job`, skipping units that are already done.

    workers : processes to use when not `job.workers`, which a resumed job keeps for its plan
    errors : StoppedError when stopped by a signal, a full disk or a unit that keeps dying;
        whatever GstreamError a unit raises
    """
    progress = progress or Silent()
    count = job.workers if workers is None else workers
    started, cpu = perf_counter(), _cpu_seconds()
    with ExitStack() as stack:
        stack.enter_context(stop_on_signals((f"{job.output}.wip", f"{job.stream}.wip")))
        memory = stack.enter_context(MemorySampler())
        with Workers(count) as pool:
            reports = tuple(_run_stage(job, stage, pool, progress) for stage in stages)
        memory.sample()
    return RunReport(
        output=job.output,
        output_bytes=os.path.getsize(job.output),
        stages=reports,
        warm_seconds=sum(report.warm_seconds for report in reports),
        seconds=perf_counter() - started,
        cpu_seconds=_cpu_seconds() - cpu,
        peak_memory=memory.peak,
        workers=count,
    )


def _run_stage(job: Job, stage: Stage, pool: Workers, progress: Progress) -> StageReport:
    started = perf_counter()
    with disk_errors(job, f"stage {stage.NAME}"), Scratch(job) as scratch:
        units = stage.plan(job)
        pending = [unit for unit in units if scratch.done(unit) is None]
    progress.stage_begins(stage.NAME, len(pending), sum(unit.cost for unit in pending))
    warm_seconds = _warm(stage) if pending else 0.0
    pool.run(stage, job, pending, lambda unit: progress.unit_done(stage.NAME, unit.cost))
    with disk_errors(job, f"stage {stage.NAME}"):
        summary = stage.finish(job)
    seconds = perf_counter() - started - warm_seconds
    progress.stage_ends(stage.NAME, seconds)
    return StageReport(
        stage=stage.NAME,
        seconds=seconds,
        warm_seconds=warm_seconds,
        units=len(units),
        resumed=len(units) - len(pending),
        counts=dict(summary.counts),
    )


def _warm(stage: Stage) -> float:
    """Compile in the parent first: many processes filling one numba cache is numba issue 4807.

    Stage by stage, so that a bad input is refused before kernels that it would never reach.
    """
    started = perf_counter()
    warm = getattr(stage, "warm", None)
    if warm is not None:
        warm()
    return perf_counter() - started


def _cpu_seconds() -> float:
    """User and system seconds of this process and of its workers that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
