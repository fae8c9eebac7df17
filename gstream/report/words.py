"""The report in words: what a series costs as a sentence, and report.md."""

from itertools import pairwise
from math import log2

from gstream.report.accuracy import Point, Report, Series
from gstream.report.knobs import UNITS, shown

HEAD = "| value | CPU s | fragments | voxels | bytes | error | fronts | "
OTHERS = "distance rms / max | surface to voxel, max | normal mean / max, ° | area |"


def price(series: Series) -> str:
    """What accuracy costs on this series, in one sentence."""
    return _lossy(series) if series.knob.error else _lossless(series)


def _lossless(series: Series) -> str:
    knob = series.knob
    wrong = [p for p in series.points if p.differing]
    if wrong:
        said = ", ".join(f"{p.differing:,} at {shown(knob.field, p.value)}" for p in wrong)
        return f"NOT LOSSLESS: {knob.same} that differ from the default's: {said}"
    fastest = min(series.points, key=lambda p: p.seconds)
    smallest = min(series.points, key=lambda p: p.counts.bytes)
    said = f"lossless: error exactly 0, the {knob.same} are the same at all values"
    if not _alike(fastest, series.default):
        gain = fastest.seconds / series.default.seconds
        said += f"; {shown(knob.field, fastest.value)} takes {gain:.2f} × the default's time"
    if smallest.counts.bytes < series.default.counts.bytes:
        gain = smallest.counts.bytes / series.default.counts.bytes
        said += f"; {shown(knob.field, smallest.value)} takes {gain:.2f} × its bytes"
    return said


def _lossy(series: Series) -> str:
    knob = series.knob
    errors = [p.error(knob) for p in series.points]
    falling = all(a > b > 0 for a, b in pairwise(errors))
    if falling and len(errors) > 2 and not isinstance(knob.values[0], str):
        first, last = series.points[0], series.points[-1]
        halvings = log2(errors[0] / errors[-1])
        return (
            f"halving the error costs {_times(first, last, 1 / halvings)} "
            f"({shown(knob.field, first.value)} to {shown(knob.field, last.value)})"
        )
    default, best = series.default, min(series.points, key=lambda p: p.error(knob))
    if best.error(knob) >= default.error(knob):
        return "no value is more accurate than the default"
    return (
        f"from the default {shown(knob.field, default.value)} to the most accurate, "
        f"{shown(knob.field, best.value)}: error {default.error(knob):.3g} to "
        f"{best.error(knob):.3g}, for {_times(default, best, 1.0)}"
    )


def _times(start: Point, end: Point, power: float) -> str:
    time = (end.seconds / start.seconds) ** power
    size = (end.counts.bytes / start.counts.bytes) ** power
    spent = "time within its spread" if _alike(start, end) else f"{time:.2g} × time"
    return f"{spent} and {size:.2g} × bytes"


def _alike(one: Point, other: Point) -> bool:
    """Their runs' seconds overlap: the medians' ratio would be noise."""
    first, second = one.all_seconds, other.all_seconds
    return min(first) <= max(second) and min(second) <= max(first)


def markdown(report: Report) -> str:
    """report.md: a table for each knob and scene, under the sentence that reads it."""
    lines = [
        "# What accuracy costs",
        "",
        f"Each value has the median CPU seconds of its fresh processes ({report.plan.runs}), "
        "kernels loaded before. One knob is turned, all others stay at their defaults. Distances "
        f"are in voxels of the default resolution, {report.plan.resolution}; all files keep their "
        "weights.",
        "",
        "| scene | triangles | the mesh's own distance from the surface, voxels |",
        "|---|---|---|",
    ]
    lines += [
        f"| {s['name']} | {s['triangles']:,} | {s['floor_voxels']:.1g} |" for s in report.scenes
    ]
    for series in report.series:
        lines += ["", f"## {series.knob.option}, {series.scene}", "", f"**{price(series)}**", ""]
        lines += table(series)
    return "\n".join(lines) + "\n"


def table(series: Series) -> list[str]:
    """A series as a Markdown table; the default is marked."""
    knob = series.knob
    unit = UNITS[knob.error] if knob.error else f"{knob.same} that differ from the default's"
    head = HEAD.replace("error", f"error: {unit}") + OTHERS
    lines = [head, "|---" * (head.count("|") - 1) + "|"]
    for p in series.points:
        fronts = [cost for cost in ("seconds", "bytes") if p in series.front(cost)]
        mark = " (default)" if p.default else ""
        error = f"{p.error(knob):.4g}" if knob.error else f"{p.differing:,}"
        e = p.errors
        lines.append(
            f"| {shown(knob.field, p.value)}{mark} | {p.seconds:.3f} | {p.counts.fragments:,} | "
            f"{p.counts.voxels:,} | {p.counts.bytes:,} | {error} | {', '.join(fronts)} | "
            f"{e.distance_rms:.3f} / {e.distance_max:.3f} | {e.cover_max:.3f} | "
            f"{e.normal_mean:.3f} / {e.normal_max:.3f} | {100 * e.area:.3f} % |"
        )
    return lines
