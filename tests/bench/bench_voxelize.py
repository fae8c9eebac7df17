"""Our voxels per CPU second beside those of Open3D's `create_from_triangle_mesh`, in one run.

Open3D is timed over its call alone, positions only (mesh in memory, nothing written). Ours is the
CPU of the whole process tree from the geometry stream to the finished block file, with normals and
all levels. Open3D is optional; it may live in an environment of its own (--open3d-python), which is
why this file imports only the standard library at the top.
"""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

GRID_MARGIN = (
    1 + 2.0**-10
)  # voxel size = largest extent * (1 + 2^-10) / N, as gstream places its grid
WARMING_TRIANGLES = 20_000


def open3d_call(mesh: Path, resolution: int) -> dict[str, Any]:
    """Time the call alone; runs under an interpreter that has open3d."""
    import open3d

    triangles = open3d.io.read_triangle_mesh(str(mesh))
    size = triangles.get_max_bound() - triangles.get_min_bound()
    before, wall = time.process_time(), time.perf_counter()
    grid = open3d.geometry.VoxelGrid.create_from_triangle_mesh(
        triangles, max(size) * GRID_MARGIN / resolution
    )
    cpu, wall = time.process_time() - before, time.perf_counter() - wall
    # get_voxels() would make a Python object of each voxel; the repr counts them
    voxels = int(re.search(r"with (\d+) voxels", repr(grid)).group(1))  # type: ignore[union-attr]
    return {
        "what": f"open3d {open3d.__version__}",
        "voxels": voxels,
        "cpu_s": cpu,
        "wall_s": wall,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def open3d_figures(python: str, mesh: Path, resolution: int) -> dict[str, Any]:
    done = subprocess.run(
        [python, __file__, "--open3d-child", str(mesh), "--resolution", str(resolution)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        return {"what": "open3d", "error": (done.stderr.strip() or "failed").splitlines()[-1]}
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def our_figures(args: argparse.Namespace, mesh: Path, folder: Path) -> dict[str, Any]:
    """Ingest, warm the kernel cache with a small run, then measure `gstream voxelize`."""
    from tests.bench.meshes import write_sphere
    from tests.bench.process import expect

    stream, output, report = folder / "scene.gst", folder / "scene.gsb", folder / "report.json"
    write_sphere(folder / "small.ply", WARMING_TRIANGLES)
    expect("ingest", folder / "small.ply", "-o", folder / "small.gst", "--force")
    settings = (
        "--sep",
        args.sep,
        "--workers",
        str(args.workers),
        "--memory",
        args.memory,
        "--force",
    )
    small = ("voxelize", folder / "small.gst", "-o", folder / "small.gsb", "--resolution", "256")
    cold, warm = expect(*small, *settings), expect(*small, *settings)
    read = expect("ingest", mesh, "-o", stream, "--lz4", "fast", "--order", "file", "--force")
    asked = ("--resolution", str(args.resolution), "--report", report)
    cost = expect("voxelize", stream, "-o", output, *asked, *settings)
    found = json.loads(report.read_text())
    voxels = next(row["voxels"] for row in found["file"]["levels"] if row["level"] == 0)
    return {
        "what": "gstream",
        "triangles": found["file"]["ledger"]["triangles"],
        "voxels": voxels,
        "cpu_s": cost.cpu_s,
        "wall_s": cost.wall_s,
        "peak_mb": cost.peak_bytes / 2**20,
        "bytes": output.stat().st_size,
        "bytes_per_voxel": output.stat().st_size / voxels,
        "stream_bytes": stream.stat().st_size,
        "compile_s": max(0.0, cold.cpu_s - warm.cpu_s),
        "start_s": warm.cpu_s,
        "ingest_cpu_s": read.cpu_s,
        "ingest_wall_s": read.wall_s,
        "stages": {row["stage"]: row["seconds"] for row in found["stages"]},
    }


def table(triangles: int, rows: list[dict[str, Any]]) -> str:
    head = [
        "",
        "voxels",
        "CPU s",
        "wall s",
        "Mtri/CPU s",
        "Mvox/CPU s",
        "Mvox/s",
        "peak MB",
        "bytes/voxel",
    ]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        if "error" in row:
            lines.append(f"| {row['what']} | {row['error']} " + "| " * (len(head) - 2) + "|")
            continue
        mega_voxels = row["voxels"] / 1e6
        cells = [row["what"], f"{row['voxels']:,}", f"{row['cpu_s']:.2f}", f"{row['wall_s']:.2f}"]
        cells += [f"{triangles / 1e6 / row['cpu_s']:.2f}", f"{mega_voxels / row['cpu_s']:.2f}"]
        cells += [f"{mega_voxels / row['wall_s']:.2f}", f"{row['peak_mb']:,.0f}"]
        cells.append(f"{row['bytes_per_voxel']:.2f}" if "bytes" in row else "")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def describe(ours: dict[str, Any], triangles: int) -> str:
    total = sum(ours["stages"].values()) or 1.0
    shares = [f"{name} {s:.2f} s ({s / total:.0%})" for name, s in ours["stages"].items()]
    mega, per_triangle = triangles / 1e6, ours["stream_bytes"] / triangles
    return "\n".join(
        [
            f"compiling kernels: {ours['compile_s']:.1f} CPU s, not counted above",
            f"a run of {WARMING_TRIANGLES:,} triangles: {ours['start_s']:.1f} CPU s",
            f"ingest: {mega / ours['ingest_cpu_s']:.2f} Mtri/CPU s, "
            f"{mega / ours['ingest_wall_s']:.2f} Mtri/s, {per_triangle:.2f} bytes per triangle",
            f"block file: {ours['bytes']:,} bytes",
            f"stages: {', '.join(shares)}",
        ]
    )


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triangles", type=int, default=10_000_000)
    parser.add_argument("--resolution", type=int, default=2048)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--memory", default="2GiB")
    parser.add_argument("--sep", default="conservative")
    parser.add_argument(
        "--mesh", type=Path, help="measure this mesh instead of the generated sphere"
    )
    parser.add_argument(
        "--open3d-python", default=sys.executable, help="interpreter that has open3d"
    )
    parser.add_argument("--no-open3d", action="store_true")
    parser.add_argument("--keep-cache", action="store_true", help="no fresh cache of kernels")
    parser.add_argument("--only-open3d", action="store_true")
    parser.add_argument("--folder", type=Path, help="keep meshes and results here")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    parser.add_argument("--open3d-child", type=Path, help=argparse.SUPPRESS)
    return parser.parse_args()


def measure(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    from tests.bench.meshes import Sphere, write_sphere
    from tests.bench.process import machine

    mesh, triangles = args.mesh, args.triangles
    if mesh is None:
        triangles = Sphere.of_triangles(args.triangles).triangle_count
        mesh = folder / f"sphere-{triangles}.ply"
        if not mesh.exists():
            write_sphere(mesh, args.triangles)
    rows = []
    if not args.only_open3d:
        rows.append(our_figures(args, mesh, folder))
        triangles = rows[0]["triangles"]
    if not args.no_open3d:
        rows.append(open3d_figures(args.open3d_python, mesh, args.resolution))
    return {
        "machine": machine(),
        "triangles": triangles,
        "resolution": args.resolution,
        "rows": rows,
    }


def main() -> None:
    args = parse()
    if args.open3d_child:
        print(json.dumps(open3d_call(args.open3d_child, args.resolution)))
        return
    with tempfile.TemporaryDirectory(prefix="gstream-bench-") as temporary:
        folder = args.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        if not args.keep_cache:
            os.environ["NUMBA_CACHE_DIR"] = f"{temporary}/kernels"  # so that compiling is measured
        result = measure(args, folder)
    rows = result["rows"]
    print(result["machine"])
    print(f"{result['triangles']:,} triangles at {args.resolution}^3, --sep {args.sep}\n")
    print(table(result["triangles"], rows))
    for row in rows:
        if row["what"] == "gstream":
            print("\n" + describe(row, result["triangles"]))
    if len(rows) == 2 and "error" not in rows[1]:
        ours, theirs = (row["voxels"] / row["cpu_s"] for row in rows)
        result["ratio"] = ours / theirs
        print(f"ratio to Open3D in voxels per CPU second: {ours / theirs:.1f} x")
    if args.json:
        args.json.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
