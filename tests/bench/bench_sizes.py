"""File bytes per level-0 voxel of real scans, 6-separating, at about one voxel per triangle.

`python -m tests.bench.bench_sizes SCAN...`. The resolution comes from a first, coarse build: a
surface has voxels as the square of the resolution.
"""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from tests.bench.process import expect, machine, markdown, voxels_of

FIRST_RESOLUTION = 256
ROUNDS = 2  # corrections of the resolution after the first build
CLOSE = 0.05  # of the wanted count
COLUMNS = ("occupancy", "mask", "normal", "colour", "weight")


def measure(scan: Path, per_triangle: float, lz4: str, folder: Path) -> dict[str, Any]:
    stream, output = folder / "scan.gst", folder / "scan.gsb"
    expect("ingest", scan, "-o", stream, "--lz4", lz4, "--force")
    held = json.loads(expect("info", stream, "--json").out)
    triangles = int(held["triangles"])
    resolution = FIRST_RESOLUTION
    voxels = build(stream, output, resolution, lz4)
    for _ in range(ROUNDS):
        factor = (per_triangle * triangles / voxels) ** 0.5
        if abs(factor**2 - 1) <= CLOSE:
            break
        resolution = max(1, round(resolution * factor))
        voxels = build(stream, output, resolution, lz4)
    return {
        "scan": scan.name,
        "triangles": triangles,
        "resolution": resolution,
        "voxels": voxels,
        "bytes": output.stat().st_size,
        "bytes_per_voxel": output.stat().st_size / voxels,
        "columns": {name: size / voxels for name, size in column_bytes(output).items()},
        "stream_bytes_per_triangle": stream.stat().st_size / triangles,
    }


def build(stream: Path, output: Path, resolution: int, lz4: str) -> int:
    settings = ("--sep", "6", "--resolution", str(resolution), "--lz4", lz4, "--workers", "0")
    expect("voxelize", stream, "-o", output, *settings, "--force")
    return voxels_of(output)


def column_bytes(path: Path) -> dict[str, int]:
    """Stored bytes of each column over all levels; the directory and head are `rest`."""
    import gstream

    with gstream.open(path) as scene:
        found = dict.fromkeys(scene.columns, 0)
        for level in range(scene.levels):
            for block in scene.blocks(level):
                for name in found:
                    found[name] += int(block.entry[name]["stored"])
    return found | {"rest": path.stat().st_size - sum(found.values())}


def report(rows: list[dict[str, Any]]) -> str:
    names = list(dict.fromkeys(name for row in rows for name in row["columns"]))
    head = ["scan", "triangles", "resolution", "voxels", "bytes", "bytes/voxel", *names]
    cells = []
    for row in rows:
        counts = [f"{row[key]:,}" for key in ("triangles", "resolution", "voxels", "bytes")]
        shares = [f"{row['columns'].get(name, 0):.2f}" for name in names]
        cells.append([row["scan"], *counts, f"{row['bytes_per_voxel']:.2f}", *shares])
    mean = sum(row["bytes_per_voxel"] for row in rows) / len(rows)
    return markdown([*head], cells) + f"\n\nmean {mean:.2f} bytes per voxel, all levels included"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scans", type=Path, nargs="+")
    parser.add_argument("--per-triangle", type=float, default=1.0, help="voxels per triangle")
    parser.add_argument("--lz4", default="fast", choices=["fast", "hc"])
    parser.add_argument("--json", type=Path, help="write the figures here too")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gstream-bench-") as folder:
        rows = [measure(scan, args.per_triangle, args.lz4, Path(folder)) for scan in args.scans]
    print(f"{machine()}\n\n{report(rows)}")
    if args.json:
        args.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
