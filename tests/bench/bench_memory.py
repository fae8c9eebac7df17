"""Peak memory of the whole process tree while `gstream voxelize` runs, against its --memory.

`python -m tests.bench.bench_memory`: a sphere of 10 M triangles at 2048, 4096 and 8192 voxels per
axis, and one triangle that spans its scene at 16384. Sum of Pss_Anon + Pss_Shmem every 0.1 s.
"""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from tests.bench.meshes import write_sphere, write_triangle
from tests.bench.process import Cost, expect, gstream, machine, markdown, voxels_of

UNITS = {"KiB": 10, "MiB": 20, "GiB": 30}


def bytes_of(text: str) -> int:
    """`2GiB` as bytes."""
    return int(float(text[:-3]) * (1 << UNITS[text[-3:]]))


def measure(args: argparse.Namespace, folder: Path) -> list[dict[str, Any]]:
    sphere, triangle = folder / "sphere.ply", folder / "triangle.ply"
    cases = [(sphere, resolution) for resolution in args.resolutions]
    if args.resolutions:
        write_sphere(sphere, args.triangles)
    if args.span:
        write_triangle(triangle)
        cases.append((triangle, args.span))
    rows = []
    for mesh in dict.fromkeys(mesh for mesh, _ in cases):
        stream = mesh.with_suffix(".gst")
        settings = ("--memory", args.memory, "--workers", args.workers, "--tmp", folder, "--force")
        rows.append(
            row(f"ingest {mesh.stem}", expect("ingest", mesh, "-o", stream, *settings), args)
        )
        output = folder / "out.gsb"
        for resolution in (found for other, found in cases if other == mesh):
            asked = ("--sep", args.sep, "--resolution", str(resolution), *settings)
            cost = gstream("voxelize", stream, "-o", output, *asked)
            rows.append(row(f"voxelize {mesh.stem} at {resolution}", cost, args))
            if not cost.returncode:
                rows[-1] |= {"voxels": voxels_of(output), "bytes": output.stat().st_size}
                output.unlink()
    return rows


def row(what: str, cost: Cost, args: argparse.Namespace) -> dict[str, Any]:
    return {
        "what": what,
        "exit": cost.returncode,
        "error": cost.err.strip().splitlines()[-1] if cost.returncode and cost.err.strip() else "",
        "peak_mib": cost.peak_bytes / 2**20,
        "kept": cost.peak_bytes <= bytes_of(args.memory),
        "cpu_s": cost.cpu_s,
        "wall_s": cost.wall_s,
        "samples": cost.samples,
    }


def report(rows: list[dict[str, Any]]) -> str:
    cells = []
    for found in rows:
        verdict = found["error"] or ("within" if found["kept"] else "ABOVE THE CAP")
        counts = [f"{found[name]:,}" if name in found else "" for name in ("voxels", "bytes")]
        times = [f"{found['wall_s']:.1f}", f"{found['cpu_s']:.1f}"]
        cells.append([found["what"], f"{found['peak_mib']:,.0f}", verdict, *times, *counts])
    return markdown(["command", "peak MiB", "", "wall s", "CPU s", "voxels", "bytes"], cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triangles", type=int, default=10_000_000)
    parser.add_argument("--resolutions", type=int, nargs="*", default=[2048, 4096, 8192])
    parser.add_argument("--span", type=int, default=16384, help="voxels for the one huge triangle")
    parser.add_argument("--sep", default="conservative")
    parser.add_argument("--workers", default="2")
    parser.add_argument("--memory", default="2GiB")
    parser.add_argument(
        "--folder", type=Path, help="where meshes and scratch go (needs tens of GB)"
    )
    parser.add_argument("--json", type=Path, help="write the figures here too")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gstream-bench-", dir=args.folder) as folder:
        rows = measure(args, Path(folder))
    print(f"{machine()}\n--memory {args.memory} --workers {args.workers}\n\n{report(rows)}")
    if args.json:
        args.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
