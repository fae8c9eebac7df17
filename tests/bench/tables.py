"""The tables of a ladder's result, in Markdown."""

from collections.abc import Iterable
from itertools import groupby
from typing import Any

from tests.bench.figures import DiskRate, least_seconds, per
from tests.bench.process import markdown
from tests.bench.runs import Run
from tests.bench.slopes import TRIANGLES, Slope

MIB = 1 << 20
EXTRAPOLATED = 10**9  # triangles
FARTHEST = 40  # times the largest measured


def number(value: float | None, digits: int = 2) -> str:
    """Empty for what there is not."""
    return "" if value is None else f"{value:,.{digits}f}"


def label(run: Run) -> str:
    edge = f", edge {run.edge:g}" if run.edge else ""
    place = f" at {run.resolution}^3{edge}" if run.resolution else ""
    return f"{run.command} {run.mesh}{place}"


def speed_table(runs: Iterable[Run], memory: int) -> str:
    head = ["run", "voxels", "CPU s", "wall s", "Mtri / CPU s", "Mvox / CPU s"]
    head += ["scratch B/tri", "output B/tri", "output B/voxel", "peak MiB"]
    rows = []
    for run in runs:
        above = " ABOVE --memory" if run.peak_bytes > memory else ""
        rows.append(
            [
                label(run),
                f"{run.voxels:,}" if run.voxels else "",
                number(run.cpu_s),
                number(run.wall_s),
                number(run.triangles / 1e6 / run.cpu_s, 3),
                number(run.voxels / 1e6 / run.cpu_s, 3) if run.voxels else "",
                number(run.scratch_bytes / run.triangles, 1),
                number(run.output_bytes / run.triangles, 1),
                number(per(run.output_bytes, run.voxels)),
                number(run.peak_bytes / MIB, 0) + above,
            ]
        )
    return markdown(head, rows)


def disk_table(runs: Iterable[Run], rate: DiskRate) -> str:
    """What had to be moved, what was, and how far the run is from the disk's bound."""
    head = ["run", "least MB read + written", "read by calls", "written", "of a disk", "to a disk"]
    head += ["bound s", "wall / bound", "estimate / used"]
    rows = []
    for run in runs:
        least = [run.input_bytes + run.scratch_bytes, run.scratch_bytes + run.output_bytes]
        moved = (run.read_bytes, run.written_bytes, run.disk_read_bytes, run.disk_written_bytes)
        bound = least_seconds(rate, run.input_bytes, run.scratch_bytes, run.output_bytes)
        cells = [" + ".join(number(size / 1e6, 1) for size in least)]
        cells += [number(size / 1e6, 1) for size in moved]
        cells += [number(bound, 3), number(run.wall_s / bound, 1), number(run.estimate)]
        rows.append([label(run), *cells])
    return markdown(head, rows)


def share_table(runs: list[Run]) -> str:
    """Of each run's CPU time, what its stages took."""
    names = sorted({name for run in runs for name in run.shares})
    rows = [
        [label(run), *(f"{run.shares[name]:.0%}" if name in run.shares else "" for name in names)]
        for run in runs
    ]
    return markdown(["run", *names], rows)


def stage_table(run: Run, rate: DiskRate) -> str:
    """Each stage of one run beside the time that its bytes need of the disk."""
    head = ["stage", "wall s", "CPU s", "CPU s / workers", "workers busy", "MB read", "MB written"]
    head += ["disk s", "wall / larger bound", "peak MiB"]
    rows = []
    for stage in run.stages:
        wall, workers = stage["seconds"], max(1, run.workers)
        each = stage["cpu_seconds"] / workers
        moved = [stage["read_bytes"], stage["written_bytes"]]
        disk = rate.seconds(*moved)
        busy = per(stage["unit_seconds"], wall * min(workers, stage["units"]))
        rows.append(
            [
                stage["stage"],
                number(wall),
                number(stage["cpu_seconds"]),
                number(each),
                "" if busy is None else f"{busy:.0%}",
                *(number(size / 1e6, 1) for size in moved),
                number(disk, 3),
                number(per(wall, max(each, disk)), 1),
                number(stage["peak_memory"] / MIB, 0),
            ]
        )
    return markdown(head, rows)


def slope_table(slopes: Iterable[Slope]) -> str:
    head = ["CPU seconds of", "against", "runs", "slope", "without the start's"]
    head += [f"10^9 {TRIANGLES}, extrapolated: CPU s"]
    rows = []
    for found in slopes:
        span = f"{found.unit}, {found.smallest:,} to {found.largest:,}"
        near = found.unit == TRIANGLES and found.largest * FARTHEST >= EXTRAPOLATED
        far = found.net.at(EXTRAPOLATED) if found.net and near else None
        laws = ["" if law is None else number(law.slope, 3) for law in (found.law, found.net)]
        rows.append([found.what, span, found.runs, *laws, number(far, 0)])
    return markdown(head, rows)


def peer_table(rows: Iterable[dict[str, Any]]) -> str:
    """rows : of `Peers.measure`, each with the Run it stands beside as `ours`."""
    head = ["mesh", "who", "voxels", "CPU s", "wall s", "Mvox / CPU s", "peak MiB"]
    head += ["gstream's voxels / CPU s over its"]
    cells = []
    for run, some in groupby(rows, lambda row: row["ours"]):
        mine = {"what": "gstream", "voxels": run.voxels, "cpu_s": run.cpu_s, "wall_s": run.wall_s}
        for row in [mine | {"peak_bytes": run.peak_bytes}, *some]:
            mesh = f"{run.mesh} at {run.resolution}^3"
            if "error" in row:
                cells.append([mesh, row["what"], row["error"], *[""] * 5])
                continue
            # a program that does not say its count is credited with ours
            rate = per(row.get("voxels", run.voxels) / 1e6, row["cpu_s"])
            cells.append(
                [
                    mesh,
                    row["what"],
                    f"{row['voxels']:,}" if "voxels" in row else "",
                    *(number(row[key]) for key in ("cpu_s", "wall_s")),
                    number(rate, 3),
                    number(row["peak_bytes"] / MIB, 0),
                    number(per(run.voxels / 1e6 / run.cpu_s, rate), 1) if "ours" in row else "",
                ]
            )
    return markdown(head, cells)
