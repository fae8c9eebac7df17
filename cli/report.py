"""The report of a job: a table for a person, and the same as JSON."""

import sys
from collections.abc import Iterator
from typing import Any

from gstream.run.pipeline import RunReport

from .facts import facts
from .progress import clock

LEDGER = {  # what `facts` calls it -> what the table calls it, in the table's order
    "triangles": "triangles in",
    "read": "triangles in",
    "non_finite": "  not finite",
    "outside": "  outside the bounds",
    "unassigned": "  meeting no voxel",
    "assigned": "  assigned to voxels",
    "degenerate": "  degenerate, of all",
    "fragments": "fragments",
}


def full_report(run: RunReport) -> dict[str, Any]:
    """What the job did, and what its output holds, as JSON values."""
    return {**run.as_dict(), "file": facts(run.output)}


def table(report: dict[str, Any]) -> None:
    """Print the report on stdout."""
    from rich.console import Console
    from rich.table import Table

    rows = Table(show_header=False, box=None, pad_edge=False)
    rows.add_column(style="bold")
    rows.add_column(justify="right")
    for name, value in _rows(report):
        rows.add_row(name, value)
    Console(file=sys.stdout, highlight=False).print(rows)


def _rows(report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    held = report["file"]
    ledger = held["ledger"]
    for name, label in LEDGER.items():
        if name in ledger:
            yield label, f"{ledger[name]:,}"
    if ledger.get("area_total"):
        yield "area in unset voxels", f"{100 * ledger['area_pruned'] / ledger['area_total']:.2f} %"
    for level in held.get("levels", []):
        yield f"voxels of level {level['level']}", f"{level['voxels']:,}"
    for stage in report["stages"]:
        units = f"{stage['units']} unit{'s' if stage['units'] != 1 else ''}"
        before = f", {stage['resumed']} done before" if stage["resumed"] else ""
        yield f"stage {stage['stage']}", f"{stage['seconds']:.2f} s, {units}{before}"
    yield "kernels loaded or compiled", f"{report['warm_seconds']:.2f} s"
    yield "time in all", f"{clock(report['seconds'])} ({report['cpu_seconds']:.1f} s of CPU)"
    yield "bytes", f"{report['output_bytes']:,}"
    if held.get("bytes_per_voxel") is not None:
        yield "bytes per voxel of level 0", f"{held['bytes_per_voxel']:.2f}"
    yield "peak memory", f"{report['peak_memory'] / (1 << 20):,.0f} MiB"
