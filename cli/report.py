"""The report of a job: a table for a person, and the same as JSON."""

import sys
from collections.abc import Iterator
from typing import Any

from gstream.run.pipeline import RunReport

from .facts import facts
from .progress import clock


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
    for name, count in held["ledger"].items():
        if isinstance(count, int):
            yield name.replace("_", " "), f"{count:,}"
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
