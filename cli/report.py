"""The report of a job: a table for a person, and the same as JSON."""

import sys
from collections.abc import Callable, Iterator
from typing import Any

from gstream.run.pipeline import RunReport

from .facts import facts
from .pace import clock

LEDGER = {  # what `facts` calls it -> what the table calls it, in the table's order
    "triangles": "triangles in",
    "read": "triangles in",
    "non_finite": "  not finite",
    "outside": "  outside the bounds",
    "unassigned": "  meeting no voxel",
    "assigned": "  assigned to voxels",
    "degenerate": "  degenerate, of all",
    "fragments": "fragments",
    "pieces": "pieces of source triangles",
    "pieces_left_out": "  left out",
}


def full_report(run: RunReport) -> dict[str, Any]:
    """What the job did, and what its output holds, as JSON values."""
    return {**run.as_dict(), "file": facts(run.output)}


STAGE: dict[str, Callable[[dict[str, Any]], str]] = {  # column of a stage's row -> its value
    "stage": lambda stage: stage["stage"],
    "units": lambda stage: f"{stage['units']:,}",
    "done before": lambda stage: f"{stage['resumed']:,}",
    "seconds": lambda stage: f"{stage['seconds']:.2f}",
    "CPU s": lambda stage: f"{stage['cpu_seconds']:.2f}",
    "MiB read": lambda stage: _mib(stage["read_bytes"]),
    "MiB written": lambda stage: _mib(stage["written_bytes"]),
    "peak MiB": lambda stage: _mib(stage["peak_memory"]),
}


def table(report: dict[str, Any]) -> None:
    """Print the report on stdout."""
    from rich.console import Console
    from rich.table import Table

    held = Table(show_header=False, box=None, pad_edge=False)
    held.add_column(style="bold")
    held.add_column(justify="right")
    for name, value in (*_contents(report["file"]), *_totals(report)):
        held.add_row(name, value)
    stages = Table(box=None, pad_edge=False)
    for name in STAGE:
        stages.add_column(name, justify="left" if name == "stage" else "right")
    for stage in report["stages"]:
        stages.add_row(*(value(stage) for value in STAGE.values()))
    console = Console(file=sys.stdout, highlight=False)
    console.print(held)
    console.print(stages)


def _contents(held: dict[str, Any]) -> Iterator[tuple[str, str]]:
    ledger = held["ledger"]
    for name, label in LEDGER.items():
        if name in ledger:
            yield label, f"{ledger[name]:,}"
    if ledger.get("area_total"):
        yield "area in unset voxels", f"{100 * ledger['area_pruned'] / ledger['area_total']:.2f} %"
    for level in held.get("levels", []):
        yield f"voxels of level {level['level']}", f"{level['voxels']:,}"


def _totals(report: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "bytes", f"{report['output_bytes']:,}"
    if report["file"].get("bytes_per_voxel") is not None:
        yield "bytes per voxel of level 0", f"{report['file']['bytes_per_voxel']:.2f}"
    yield "time in all", f"{clock(report['seconds'])} ({report['cpu_seconds']:.1f} s of CPU)"
    yield "kernels loaded or compiled", f"{report['warm_seconds']:.2f} s"
    yield "peak memory", f"{_mib(report['peak_memory'])} MiB"


def _mib(size: int) -> str:
    return f"{size / (1 << 20):,.0f}"
