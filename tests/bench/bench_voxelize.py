"""Our voxels per CPU second beside those of Open3D's `create_from_triangle_mesh`, in one run.

Open3D is timed over its call alone, positions only (mesh in memory, nothing written). Ours is the
CPU of the whole process tree from the geometry stream to the finished block file, with normals and
all levels. Open3D is optional; it may live in an environment of its own (--open3d-python), which is
why this file imports only the standard library at the top.
"""

import argparse
import json
import os
import platform
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

TREE_MARGIN = (
    1 + 2.0**-10
)  # voxel size = largest extent * (1 + 2^-10) / N, as gstream places its grid
SAMPLE_SECONDS = 0.1


def open3d_call(mesh: Path, resolution: int) -> dict[str, Any]:
    """Time the call alone; runs under an interpreter that has open3d."""
    import open3d

    triangles = open3d.io.read_triangle_mesh(str(mesh))
    size = triangles.get_max_bound() - triangles.get_min_bound()
    before, wall = time.process_time(), time.perf_counter()
    grid = open3d.geometry.VoxelGrid.create_from_triangle_mesh(
        triangles, max(size) * TREE_MARGIN / resolution
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


def run_gstream(*arguments: str, env: dict[str, str] | None = None) -> tuple[float, float, float]:
    """Run one gstream command: CPU s of its whole process tree, wall s, peak MB."""
    from tests.bench.bench_memory import watch

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-m", "gstream_cli.main", *arguments], env=env)
    peak = watch(process, SAMPLE_SECONDS)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode:
        raise SystemExit(f"gstream {' '.join(arguments)}: exit code {process.returncode}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return cpu, wall, peak.bytes / 2**20


def our_figures(args: argparse.Namespace, mesh: Path, folder: Path) -> dict[str, Any]:
    """Ingest, warm the kernel cache with a small run, then measure `gstream voxelize`."""
    from tests.bench.meshes import write_sphere

    stream, output, report = folder / "scene.gst", folder / "scene.gsb", folder / "report.json"
    small, settings = folder / "small.ply", ["--sep", args.sep, "--workers", str(args.workers)]
    write_sphere(small, 20_000)
    run_gstream("ingest", str(small), "-o", str(folder / "small.gst"), "--force")
    warming = [
        "voxelize",
        str(folder / "small.gst"),
        "-o",
        str(folder / "small.gsb"),
        "--resolution",
        "256",
    ]
    cold, _, _ = run_gstream(*warming, *settings, "--force")
    warm, _, _ = run_gstream(*warming, *settings, "--force")
    ingest_cpu, ingest_wall, _ = run_gstream(
        "ingest", str(mesh), "-o", str(stream), "--lz4", "fast", "--order", "file", "--force"
    )
    cpu, wall, peak = run_gstream(
        *("voxelize", str(stream), "-o", str(output), "--resolution", str(args.resolution)),
        *(*settings, "--memory", args.memory, "--report", str(report), "--force"),
    )
    found = json.loads(report.read_text())
    voxels = level_zero_voxels(output)
    return {
        "what": "gstream",
        "voxels": voxels,
        "cpu_s": cpu,
        "wall_s": wall,
        "peak_mb": peak,
        "bytes": output.stat().st_size,
        "bytes_per_voxel": output.stat().st_size / voxels,
        "stream_bytes": stream.stat().st_size,
        "compile_s": max(0.0, cold - warm),
        "start_s": warm,
        "ingest_cpu_s": ingest_cpu,
        "ingest_wall_s": ingest_wall,
        "stages": stage_seconds(found),
    }


def level_zero_voxels(path: Path) -> int:
    """The finest level's voxel count, from `gstream info --json`."""
    done = subprocess.run(
        [sys.executable, "-m", "gstream_cli.main", "info", str(path), "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    levels = json.loads(done.stdout)["levels"]
    return int(next(level for level in levels if level["level"] == 0)["voxels"])


def stage_seconds(report: dict[str, Any]) -> dict[str, float]:
    """Seconds of each stage by name, from the report's `stages`: records, or a mapping."""
    stages = report.get("stages", [])
    if isinstance(stages, dict):
        pairs = list(stages.items())
    else:
        pairs = [(str(row.get("stage", row.get("name"))), row) for row in stages]
    return {
        name: float(row["seconds"] if isinstance(row, dict) else row)
        for name, row in pairs
        if not isinstance(row, dict) or "seconds" in row
    }


def machine() -> str:
    """Cores, processor and clock, as this process sees them."""
    try:
        text = Path("/proc/cpuinfo").read_text()
        model = re.search(r"model name\s*: (.*)", text)
        clock = re.search(r"cpu MHz\s*: (.*)", text)
        name = model[1] if model else platform.processor()
        name += f", {float(clock[1]) / 1000:.2f} GHz" if clock else ""
    except OSError:
        name = platform.processor() or platform.machine()
    load = os.getloadavg()[0]
    return f"{os.cpu_count()} cores, {name}, load {load:.1f}, Python {platform.python_version()}"


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
    shares = ", ".join(f"{name} {s:.2f} s ({s / total:.0%})" for name, s in ours["stages"].items())
    return (
        f"kernels compiled in {ours['compile_s']:.1f} CPU s (not counted above); a 20 k triangle run costs "
        f"{ours['start_s']:.1f} CPU s\ningest: {triangles / 1e6 / ours['ingest_cpu_s']:.2f} Mtri/CPU s, "
        f"{triangles / 1e6 / ours['ingest_wall_s']:.2f} Mtri/s wall, {ours['stream_bytes'] / triangles:.2f} bytes per triangle\n"
        f"block file: {ours['bytes']:,} bytes\nstages: {shares or 'not in the report'}"
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
    parser.add_argument("--only-open3d", action="store_true")
    parser.add_argument("--folder", type=Path, help="keep meshes and results here")
    parser.add_argument("--json", type=Path, help="write the figures here too")
    parser.add_argument("--open3d-child", type=Path, help=argparse.SUPPRESS)
    return parser.parse_args()


def measure(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    from tests.bench.meshes import Sphere, write_sphere

    mesh, triangles = args.mesh, args.triangles
    if mesh is None:
        triangles = Sphere.of_triangles(args.triangles).triangle_count
        mesh = folder / f"sphere-{triangles}.ply"
        if not mesh.exists():
            write_sphere(mesh, args.triangles)
    rows = []
    if not args.only_open3d:
        rows.append(our_figures(args, mesh, folder))
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
        result = measure(args, folder)
    rows = result["rows"]
    print(
        f"{result['machine']}\n{result['triangles']:,} triangles at {args.resolution}^3, --sep {args.sep}\n"
    )
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
