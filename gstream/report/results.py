"""What was measured: points, series of them, and the report as JSON."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from statistics import median
from typing import Any

from gstream.report.knobs import Knob

FORMAT = 2  # of report.json


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run."""

    scenes: tuple[str, ...]  # built-in ones, or the one file's path
    resolution: int  # the default's
    knobs: tuple[Knob, ...]
    runs: int  # processes of each point


@dataclass(frozen=True, slots=True)
class Point:
    """One value of one knob on one scene."""

    value: Any
    default: bool
    all_seconds: tuple[float, ...]  # CPU, without loading kernels, of each process
    rejected: int  # processes whose counts were not the first one's
    counts: Mapping[str, Any]  # triangles, fragments, voxels, bytes...: equal in every process
    errors: Mapping[str, float]
    differing: int | None = None  # lossless knobs: bytes or voxels that are not the default's

    @property
    def seconds(self) -> float:
        """The median."""
        return median(self.all_seconds)

    def error(self, knob: Knob) -> float:
        """What the knob is judged by."""
        return self.errors[knob.error] if knob.error else float(self.differing or 0)

    def cost(self, cost: str) -> float:
        """`seconds`, or one of the counts."""
        return self.seconds if cost == "seconds" else float(self.counts[cost])


class Samples:
    """All runs of one point."""

    def __init__(self, seconds: float | None, counts: Mapping[str, Any]) -> None:
        self._seconds = [] if seconds is None else [seconds]
        self._counts, self._rejected = counts, 0
        self.errors: Mapping[str, float] = {}
        self.differing: int | None = None

    def add(self, seconds: float | None, counts: Mapping[str, Any]) -> None:
        """Take a run in, or reject it where it did not do what the first one did."""
        if counts != self._counts:
            self._rejected += 1
        elif seconds is not None:
            self._seconds.append(seconds)

    def point(self, knob: Knob, value: Any) -> Point:
        return Point(
            value, value == knob.default, tuple(self._seconds), self._rejected, self._counts,
            self.errors, None if knob.error else self.differing or 0,
        )  # fmt: skip


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
        """Pareto front: the points that none beats in both `cost` and error."""
        ordered = sorted(self.points, key=lambda p: (p.cost(cost), p.error(self.knob)))
        kept: list[Point] = []
        for point in ordered:
            if not kept or point.error(self.knob) < kept[-1].error(self.knob):
                kept.append(point)
        return tuple(kept)

    def fronts(self, point: Point) -> list[str]:
        """The costs on whose fronts a point is."""
        return [cost for cost in self.knob.costs if point in self.front(cost)]


@dataclass(frozen=True, slots=True)
class Report:
    """All series, and what they were measured on."""

    plan: Plan
    scenes: tuple[Mapping[str, Any], ...]  # name, triangles, area, floor in voxels of the default
    series: tuple[Series, ...]
    machine: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # a line for each thing that could not be measured


def as_dict(report: Report, prices: Iterable[str]) -> dict[str, Any]:
    """report.json; `prices` : the sentence of each series."""
    return {
        "format": FORMAT,
        "machine": dict(report.machine),
        "resolution": report.plan.resolution,
        "runs": report.plan.runs,
        "scenes": [dict(scene) for scene in report.scenes],
        "notes": list(report.notes),
        "series": [
            {
                "scene": series.scene,
                "knob": series.knob.name,
                "option": bool(series.knob.field),
                "scene_key": series.knob.key or None,
                "error": series.knob.error or f"differing {series.knob.same}",
                "lossless": not series.knob.error,
                "price": price,
                "points": [
                    {**asdict(point), "seconds": point.seconds, "fronts": series.fronts(point)}
                    if "seconds" in series.knob.costs
                    else {**asdict(point), "fronts": series.fronts(point)}
                    for point in series.points
                ],
            }
            for series, price in zip(report.series, prices, strict=True)
        ],
    }
