"""What accuracy costs: every knob turned on every scene, each point in fresh processes.

A point has the median of its runs' CPU seconds, the counts that are the same in all of them, and
its errors against the true surface. Runs one after another, so that they do not slow each other.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from hashlib import blake2b
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from gstream.errors import GstreamError, UsageError
from gstream.job import IngestSettings
from gstream.read import open_block_file
from gstream.report.knobs import BYTES, Knob, fewer, knobs, settings_at
from gstream.report.metrics import (
    Content,
    Errors,
    differing_bytes,
    differing_voxels,
    errors_of,
    read_content,
)
from gstream.report.scenes import SCENES, Scene, write_ply
from gstream.run import commands
from gstream.run.commands import RunOptions
from gstream.run.progress import Progress

FORMAT = 1  # of report.json
SETS = {"small": (("sphere",), 128), "all": (tuple(SCENES), 256)}  # scenes, voxels per axis


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run."""

    scenes: tuple[str, ...]
    resolution: int  # the default's
    knobs: tuple[Knob, ...]
    runs: int  # processes of each point


@dataclass(frozen=True, slots=True)
class Counts:
    """What a run did and wrote; equal in every run of a point, unlike seconds."""

    triangles: int
    fragments: int
    voxels: int  # of level 0
    bytes: int
    digest: str  # BLAKE2b of the file

    @classmethod
    def of(cls, report: Mapping[str, Any], output: Path) -> "Counts":
        counts = {stage["stage"]: stage["counts"] for stage in report["stages"]}
        voxelize, data = counts["4-voxelize"], output.read_bytes()
        digest = blake2b(data, digest_size=16).hexdigest()
        triangles = counts["3-presort"]["triangles"]
        return cls(triangles, voxelize["fragments"], voxelize["voxels"], len(data), digest)


@dataclass(frozen=True, slots=True)
class Point:
    """One value of one knob on one scene."""

    value: Any
    default: bool
    seconds: float  # CPU, of the process tree, without loading kernels: the median
    all_seconds: tuple[float, ...]
    rejected: int  # runs whose counts were not the first one's
    counts: Counts
    errors: Errors
    differing: int | None  # lossless knobs: bytes or voxels that are not the default's

    def error(self, knob: Knob) -> float:
        """What the knob is judged by."""
        return float(getattr(self.errors, knob.error)) if knob.error else float(self.differing or 0)


@dataclass(frozen=True, slots=True)
class Series:
    """A knob on a scene."""

    scene: str
    knob: Knob
    points: tuple[Point, ...]

    @property
    def default(self) -> Point:
        return next(point for point in self.points if point.default)

    def front(self, cost: str) -> tuple[Point, ...]:
        """Pareto front: the points that none beats in both `cost` (seconds, bytes) and error."""
        ordered = sorted(self.points, key=lambda p: (cost_of(p, cost), p.error(self.knob)))
        kept: list[Point] = []
        for point in ordered:
            if not kept or point.error(self.knob) < kept[-1].error(self.knob):
                kept.append(point)
        return tuple(kept)


@dataclass(frozen=True, slots=True)
class Report:
    """All series, and what they were measured on."""

    plan: Plan
    scenes: tuple[Mapping[str, Any], ...]  # name, triangles, area, floor in voxels of the default
    series: tuple[Series, ...]
    machine: Mapping[str, Any] = field(default_factory=dict)


def cost_of(point: Point, cost: str) -> float:
    """`seconds` or `bytes` of a point."""
    return point.seconds if cost == "seconds" else float(point.counts.bytes)


def plan_of(scenes: str, names: Sequence[str], runs: int) -> Plan:
    """The plan for `small` or `all` scenes and the knobs named, or all of them.

    errors : UsageError for a set or a knob that there is not, or no run
    """
    if scenes not in SETS:
        raise UsageError(f"there are no scenes {scenes!r}", f"give one of {', '.join(SETS)}")
    if runs < 1:
        raise UsageError(f"--runs {runs} is out of range", "give 1 or more")
    chosen, resolution = SETS[scenes]
    known = {knob.name: knob for knob in knobs(resolution)}
    for name in names:
        if name not in known:
            raise UsageError(f"there is no knob {name!r}", f"give one of {', '.join(known)}")
    turned = [knob for knob in known.values() if not names or knob.name in names]
    if scenes == "small":
        turned = [fewer(knob, resolution) for knob in turned]
    return Plan(chosen, resolution, tuple(turned), runs)


def measure(plan: Plan, progress: Progress, tmp: str | None = None) -> Report:
    """Run the plan; a stage of `progress` for each scene.

    tmp : folder for scratch, removed at the end; None = the system's
    errors : GstreamError where a run fails or its counts cannot be right
    """
    about, series = [], []
    for name in plan.scenes:
        scene = SCENES[name](2 * plan.resolution)  # fine enough for the largest value of the knob
        with TemporaryDirectory(prefix="gstream-report-", dir=tmp) as folder:
            bench = _Bench(scene, plan, Path(folder), progress)
            series += bench.series()
            about.append(bench.about())
    machine = {"processors": os.cpu_count(), "python": sys.version.split()[0]}
    return Report(plan, tuple(about), tuple(series), machine)


class _Bench:
    """One scene: its stream, and the points measured so far."""

    def __init__(self, scene: Scene, plan: Plan, folder: Path, progress: Progress) -> None:
        self._scene, self._plan, self._progress = scene, plan, progress
        self._stream, self._output = folder / "scene.gst", folder / "scene.gsb"
        self._default: _Default | None = None
        write_ply(scene, folder / "scene.ply")
        settings = IngestSettings(inputs=(str(folder / "scene.ply"),))
        commands.ingest(settings, str(self._stream), RunOptions(workers=0)).run()

    def series(self) -> list[Series]:
        """Every value once, then all of them again: a machine that slows down slows all alike."""
        base = settings_at(self._plan.resolution, {})
        turned = [
            (knob, value)
            for knob in self._plan.knobs
            for value in knob.values
            if value != base[knob.field]
        ]
        runs = (1 + len(turned)) * self._plan.runs
        self._progress.stage_begins(self._scene.name, runs, float(runs))
        _fresh(self._request({"resolution": 32}))  # not timed: it compiles what is not yet cached
        default = _Runs({}, *self._judged({}, None))
        others = {
            (k.name, v): _Runs({k.field: v}, *self._judged({k.field: v}, k)) for k, v in turned
        }
        for _ in range(self._plan.runs - 1):
            for runs_of in (default, *others.values()):
                runs_of.add(*self._run(runs_of.changed))
        self._progress.stage_ends(self._scene.name, 0.0)
        return [
            Series(
                self._scene.name,
                knob,
                tuple(
                    others.get((knob.name, v), default).point(v, v == base[knob.field], knob)
                    for v in knob.values
                ),
            )
            for knob in self._plan.knobs
        ]

    def about(self) -> dict[str, Any]:
        return {
            "name": self._scene.name,
            "triangles": len(self._scene.triangles),
            "area": self._scene.area,
            "floor_voxels": self._scene.floor / self._default.voxel_size if self._default else None,
        }

    def _request(self, changed: Mapping[str, Any]) -> dict[str, Any]:
        settings = settings_at(self._plan.resolution, changed)
        return {"stream": str(self._stream), "output": str(self._output), "settings": settings}

    def _run(self, changed: Mapping[str, Any]) -> tuple[float, Counts]:
        report = _fresh(self._request(changed))
        self._progress.unit_done(self._scene.name, 1.0)
        return report["cpu_seconds"], Counts.of(report, self._output)

    def _judged(
        self, changed: Mapping[str, Any], knob: Knob | None
    ) -> tuple[float, Counts, Errors, int]:
        """The first run of a point, its file read back; the default comes first, without a knob."""
        seconds, counts = self._run(changed)
        with open_block_file(self._output) as file:
            content, matrix = read_content(file), file.matrix
        self._check("triangles", counts.triangles, len(self._scene.triangles))
        self._check("voxels", counts.voxels, len(content.positions))
        data = self._output.read_bytes()
        if self._default is None:
            self._default = _Default(content, data, float(matrix[0, 0]))
        errors = errors_of(content, matrix, self._scene, self._default.voxel_size)
        differing = 0
        if knob is not None and knob.same == BYTES:
            differing = differing_bytes(data, self._default.data)
        elif knob is not None and knob.same:
            differing = differing_voxels(content, self._default.content)
        return seconds, counts, errors, differing

    def _check(self, what: str, counted: int, expected: int) -> None:
        if counted != expected:
            raise GstreamError(f"{self._scene.name}: {counted} {what} counted, not {expected}")


@dataclass(frozen=True, slots=True)
class _Default:
    """What lossless knobs are compared with."""

    content: Content
    data: bytes
    voxel_size: float


class _Runs:
    """The runs of one point."""

    def __init__(
        self,
        changed: Mapping[str, Any],
        seconds: float,
        counts: Counts,
        errors: Errors,
        differing: int,
    ) -> None:
        self.changed, self._counts, self._errors = changed, counts, errors
        self._differing, self._seconds, self._rejected = differing, [seconds], 0

    def add(self, seconds: float, counts: Counts) -> None:
        """Take a run in, or reject it where it did not do what the first one did."""
        if counts == self._counts:
            self._seconds.append(seconds)
        else:
            self._rejected += 1

    def point(self, value: Any, default: bool, knob: Knob) -> Point:
        differing = None if knob.error else self._differing
        seconds = tuple(self._seconds)
        return Point(
            value, default, median(seconds), seconds, self._rejected, self._counts, self._errors,
            differing,
        )  # fmt: skip


def _fresh(request: Mapping[str, Any]) -> dict[str, Any]:
    """The report of one run in a new process."""
    command = [sys.executable, "-P", "-m", "gstream.report.point", json.dumps(request)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise GstreamError(f"a run of the report failed: {said}; settings {request['settings']}")
    return dict(json.loads(done.stdout))


def as_dict(report: Report, prices: Iterable[str]) -> dict[str, Any]:
    """report.json; `prices` : the sentence of each series."""
    return {
        "format": FORMAT,
        "machine": dict(report.machine),
        "resolution": report.plan.resolution,
        "runs": report.plan.runs,
        "scenes": [dict(scene) for scene in report.scenes],
        "series": [
            {
                "scene": series.scene,
                "knob": series.knob.name,
                "error": series.knob.error or f"differing {series.knob.same}",
                "lossless": not series.knob.error,
                "price": price,
                "points": [
                    {
                        **asdict(point),
                        "fronts": [
                            cost for cost in ("seconds", "bytes") if point in series.front(cost)
                        ],
                    }
                    for point in series.points
                ],
            }
            for series, price in zip(report.series, prices, strict=True)
        ],
    }
