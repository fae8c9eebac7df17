"""The report in words: what a series costs as a sentence, and report.md."""

from itertools import pairwise
from math import log2
from statistics import median

from gstream.report.knobs import UNITS, shown
from gstream.report.results import Point, Report, Series

COSTS = {
    "seconds": "time",
    "bytes": "bytes",
    "faces": "faces",
    "voxels": "voxels",
    "frames": "frames until the picture is final",
    "largest": "bytes of the largest frame",
}
ERRORS = {  # heads of the other errors' columns
    "distance_rms": "distance, rms",
    "distance_max": "distance, max",
    "cover_max": "surface to voxel, max",
    "normal_mean": "normal, mean °",
    "normal_max": "normal, max °",
    "area": "area, part",
    "misclassified": "misclassified",
    "leaks": "leaks",
    "colour_mean": "colour, mean",
    "colour_max": "colour, max",
    "image_rms": "picture, rms",
    "edge_rms": "its edges, rms",
    "flicker": "flicker, rms",
    "holes": "holes, pictures",
    "unfinished": "unfinished, pictures",
}
COUNTS = {  # heads of their columns
    "triangles": "triangles",
    "fragments": "fragments",
    "voxels": "voxels",
    "bytes": "bytes",
    "read": "bytes read",
    "faces": "faces",
    "frames": "frames",
    "largest": "bytes of the largest frame",
}
VIEWED = (
    "Knobs of the viewer are turned on one still picture: CPU seconds of a frame that shows what "
    "the one before did, voxels drawn, bytes uploaded to the graphics card, and those read of the "
    "file, whose first levels, up to 4 MiB, come with its head. Errors are those against a picture "
    "with 64 samples in each pixel: of finest voxels for the pixel error, else of the same voxels. "
    "Flicker is how unevenly pixels change while the camera turns by an eighth of a pixel a frame. "
    "Holes and unfinished are what a picture that streams lacks of its last frame, parts of its "
    "pixels added up over the frames."
)


def price(series: Series) -> str:
    """What accuracy costs on this series, in one sentence."""
    return _lossy(series) if series.knob.error else _lossless(series)


def _lossless(series: Series) -> str:
    knob, default = series.knob, series.default
    wrong = [p for p in series.points if p.differing]
    if wrong:
        said = ", ".join(f"{p.differing:,} at {shown(knob, p.value)}" for p in wrong)
        return f"NOT LOSSLESS: {knob.same} that differ from the default's: {said}"
    said = f"lossless: error exactly 0, the {knob.same} are the same at all values"
    whose = "the default's"
    for cost in knob.costs:
        least = min(series.points, key=lambda p: p.cost(cost))
        if least.cost(cost) == default.cost(cost):
            continue
        timed = cost == "seconds"
        gain = _time_ratio(default, least) if timed else least.cost(cost) / default.cost(cost)
        if gain is not None:
            said += f"; {shown(knob, least.value)} takes {gain:.2f} × {whose} {COSTS[cost]}"
            whose = "its"
    return said


def _lossy(series: Series) -> str:
    knob, default = series.knob, series.default
    errors = [p.error(knob) for p in series.points]
    falling = all(a > b > 0 for a, b in pairwise(errors))
    if falling and len(errors) > 2 and not isinstance(knob.values[0], str):
        first, last = series.points[0], series.points[-1]
        halvings = log2(errors[0] / errors[-1])
        spent = _times(series, first, last, 1 / halvings)
        ends = f"{shown(knob, first.value)} to {shown(knob, last.value)}"
        return f"halving the error costs {spent} ({ends})"
    best = min(series.points, key=lambda p: p.error(knob))
    if best.error(knob) < default.error(knob):
        return (
            f"from the default {shown(knob, default.value)} to the most accurate, "
            f"{shown(knob, best.value)}: error {default.error(knob):.3g} to "
            f"{best.error(knob):.3g}, for {_times(series, default, best, 1.0)}"
        )
    others = [p for p in series.points if not p.default]
    closest = min(others, key=lambda p: p.error(knob))
    cheapest = min(others, key=lambda p: p.cost(knob.costs[0]))
    said = " and ".join(
        f"{_times(series, p, default, 1.0)} of {shown(knob, p.value)}, whose error is "
        f"{p.error(knob):.3g},"
        for p in ([closest] if closest is cheapest else [closest, cheapest])
    )
    return f"the default {shown(knob, default.value)} is the most accurate, for {said[:-1]}"


def _times(series: Series, start: Point, end: Point, power: float) -> str:
    said = []
    for cost in series.knob.costs:
        timed = cost == "seconds"
        ratio = _time_ratio(start, end) if timed else end.cost(cost) / start.cost(cost)
        if ratio is None:
            said.append("time within its spread")
        else:
            scaled = ratio**power
            figure = f"{scaled:.2f}" if 0.5 < scaled < 2 else f"{scaled:.2g}"
            said.append(f"{figure} × {COSTS[cost]}")
    return " and ".join(said)


def _time_ratio(start: Point, end: Point) -> float | None:
    """The median ratio of seconds measured in one turn; None where turns disagree on its side.

    A turn's processes run next to each other, so that a machine that slows down slows both.
    """
    ratios = [b / a for a, b in zip(start.all_seconds, end.all_seconds, strict=False)]
    return None if min(ratios) <= 1 <= max(ratios) else median(ratios)


def legend(report: Report) -> list[str]:
    """How to read the tables, and what could not be measured, in paragraphs."""
    said = [
        f"Each value has the median CPU seconds of its fresh processes ({report.plan.runs}), "
        "kernels loaded before. One knob is turned, all others stay at their defaults. Distances "
        f"are in voxels of the default resolution, {report.plan.resolution}; all files keep their "
        "weights. Knobs without an option are other forms of one step, measured alone."
    ]
    if any(series.knob.key for series in report.series):
        said.append(VIEWED)
    return said + [f"{note}." for note in report.notes]


def markdown(report: Report) -> str:
    """report.md: a table for each knob and scene, under the sentence that reads it."""
    lines = ["# What accuracy costs", ""]
    for paragraph in legend(report):
        lines += [paragraph, ""]
    lines += [
        "| scene | triangles | the mesh's own distance from the surface, voxels |",
        "|---|---|---|",
    ]
    lines += [
        f"| {s['name']} | {s['triangles']:,} | {s['floor_voxels']:.1g} |" for s in report.scenes
    ]
    for series in report.series:
        lines += ["", f"## {series.knob.title}, {series.scene}", "", f"**{price(series)}**", ""]
        rows = cells(series)
        lines += [f"| {' | '.join(row)} |" for row in (rows[0], ["---"] * len(rows[0]), *rows[1:])]
    return "\n".join(lines) + "\n"


def cells(series: Series) -> list[list[str]]:
    """A series as a table, its head first: value, costs, error, fronts, all other errors."""
    knob, default = series.knob, series.default
    counts = [name for name in COUNTS if name in default.counts]
    others = [name for name in ERRORS if name in default.errors and name != knob.error]
    error = UNITS[knob.error] if knob.error else f"{knob.same} that differ from the default's"
    timed = ["CPU s"] if "seconds" in knob.costs else []
    head = [
        "value",
        *timed,
        *(COUNTS[c] for c in counts),
        f"error: {error}",
        "fronts",
        *(ERRORS[o] for o in others),
    ]
    rows = [
        [
            shown(knob, p.value) + (" (default)" if p.default else ""),
            *([f"{p.seconds:.4g}"] if timed else []),
            *(f"{p.counts[name]:,}" for name in counts),
            f"{p.error(knob):.4g}" if knob.error else f"{p.differing:,}",
            ", ".join(series.fronts(p)),
            *(f"{p.errors[name]:.4g}" for name in others),
        ]
        for p in series.points
    ]
    return [head, *rows]
