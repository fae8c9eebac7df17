"""The order of a job: each stage is planned, its missing units run, its counts summed.

Knows stages only by their three functions and executors only by `run`; which processes do the
work is the business of `local.py`.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any, Protocol

from gstream.job import Job, Summary, Unit
from gstream.run.local import Workers, stop_on_signals
from gstream.run.progress import (
    Kernels,
    Memory,
    Progress,
    Resumed,
    StageBegins,
    StageEnds,
    UnitDone,
    UnitLeftOut,
    in_turn,
    silent,
)
from gstream.run.publish import UNITS_FILE, Scratch
from gstream.run.usage import MemorySampler, Usage, tree_usage
from gstream.run.worker import disk_errors


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
    unit_seconds: float  # of all units, each in its worker
    usage: Usage  # of all processes: processor time and bytes, without the kernels
    peak_memory: int  # bytes, Σ (Pss_Anon + Pss_Shmem) over the process tree
    counts: Mapping[str, int | float | str]


@dataclass(frozen=True, slots=True)
class RunReport:
    """What a job did; `--report` writes it as JSON."""

    output: str
    output_bytes: int
    stages: tuple[StageReport, ...]  # none where an earlier run had finished the output
    warm_seconds: float  # of all stages
    seconds: float  # wall clock, all of it
    usage: Usage  # of all stages and what is between them
    peak_memory: int  # bytes, Σ (Pss_Anon + Pss_Shmem) over the process tree
    workers: int

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON values; what was taken stands beside the seconds."""
        report = asdict(self)
        return {**_flat(report), "stages": [_flat(stage) for stage in report["stages"]]}


def run_job(
    job: Job,
    stages: Sequence[Stage],
    progress: Progress | None = None,
    workers: int | None = None,
    paranoid: bool = False,
    ended: Callable[[Stage], None] = lambda stage: None,
) -> RunReport:
    """Run `stages` in order over `job`, skipping units that are already done.

    workers : processes to use when not `job.workers`, which a resumed job keeps for its plan
    paranoid : trust what an earlier run has done only after reading it
    ended : called after each stage; what it raises ends the job
    errors : StoppedError when stopped by a signal, a full disk or a unit that keeps dying;
        whatever GstreamError a unit raises
    """
    tell = in_turn(progress or silent)
    count = job.workers if workers is None else workers
    started, usage = perf_counter(), tree_usage(os.getpid())
    with ExitStack() as stack:
        stack.enter_context(stop_on_signals((f"{job.output}.wip", f"{job.stream}.wip")))
        memory = stack.enter_context(MemorySampler(lambda used, peak: tell(Memory(used, peak))))
        with Workers(count) as pool:
            running = _Running(job, pool, tell, memory, paranoid)
            reports = tuple(running.run(stage, ended) for stage in stages)
    return RunReport(
        output=job.output,
        output_bytes=os.path.getsize(job.output),
        stages=reports,
        warm_seconds=sum(report.warm_seconds for report in reports),
        seconds=perf_counter() - started,
        usage=tree_usage(os.getpid()).since(usage),
        peak_memory=memory.peak,
        workers=count,
    )


@dataclass(frozen=True, slots=True)
class _Running:
    """What the stages of one run share."""

    job: Job
    pool: Workers
    tell: Progress
    memory: MemorySampler
    paranoid: bool

    def run(self, stage: Stage, ended: Callable[[Stage], None]) -> StageReport:
        started, usage = perf_counter(), tree_usage(os.getpid())
        with disk_errors(self.job, f"stage {stage.NAME}"), Scratch(self.job) as scratch:
            scratch.drop_half_written(stage.NAME)
            units = stage.plan(self.job)
            pending = [unit for unit in units if scratch.done(unit, self.paranoid) is None]
            with scratch.write(f"{stage.NAME}/{UNITS_FILE}") as file:
                file.write(json.dumps({"units": len(units)}).encode())
        self._begin(stage, units, pending)
        warm_seconds, warming = self._warm(stage) if pending else (0.0, Usage())
        unit_seconds = 0.0

        def done(unit: Unit, seconds: float) -> None:
            nonlocal unit_seconds
            unit_seconds += seconds
            self.tell(UnitDone(stage.NAME, unit.cost, seconds, unit.name))

        def left_out(unit: Unit, cause: str) -> None:
            self.tell(UnitLeftOut(stage.NAME, unit.name, cause))

        self.pool.run(stage, self.job, pending, done, left_out, lone=len(units) == 1)
        with disk_errors(self.job, f"stage {stage.NAME}"):
            summary = stage.finish(self.job)
        report = StageReport(
            stage=stage.NAME,
            seconds=perf_counter() - started - warm_seconds,
            warm_seconds=warm_seconds,
            units=len(units),
            resumed=len(units) - len(pending),
            unit_seconds=unit_seconds,
            usage=tree_usage(os.getpid()).since(usage).since(warming),
            peak_memory=self.memory.stage_peak(),
            counts=dict(summary.counts),
        )
        self.tell(StageEnds(stage.NAME, report.seconds, report.usage, report.peak_memory))
        ended(stage)
        return report

    def _warm(self, stage: Stage) -> tuple[float, Usage]:
        """Compile in the parent first: many processes filling one numba cache is numba issue 4807.

        Stage by stage, so that a bad input is refused before kernels that it would never reach.
        """
        started, usage = perf_counter(), tree_usage(os.getpid())
        warm = getattr(stage, "warm", None)
        if warm is not None:
            self.tell(Kernels(stage.NAME, ready=False))
            warm()
            self.tell(Kernels(stage.NAME, ready=True))
        return perf_counter() - started, tree_usage(os.getpid()).since(usage)

    def _begin(self, stage: Stage, units: Sequence[Unit], pending: Sequence[Unit]) -> None:
        if len(pending) < len(units):
            self.tell(Resumed(stage.NAME, len(units) - len(pending)))
        cost, whole = (sum(unit.cost for unit in some) for some in (pending, units))
        self.tell(StageBegins(stage.NAME, len(pending), cost, cost / whole if whole else 1.0))


def _flat(report: dict[str, Any]) -> dict[str, Any]:
    return {**report.pop("usage"), **report}
