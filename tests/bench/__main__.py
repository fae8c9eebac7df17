"""The benchmark driver: the size ladder, what bounds it, and other programs beside it.

`python -m tests.bench` takes minutes, `--size large` an hour or more and 20 GB of disk. Results are
written to build/bench/ladder.md and .json after every run, and printed at the end.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gstream_cli.options import Size
from tests.bench import runs
from tests.bench.disk import measure_disk
from tests.bench.ladder import LADDERS, Ladder, Step
from tests.bench.meshes import Sphere, write_sphere, write_triangle
from tests.bench.peers import Peers
from tests.bench.process import CommandFailed, machine
from tests.bench.result import Result
from tests.bench.runs import Place, Run
from tests.bench.tables import label

TINY_TRIANGLES = 20_000
TINY_RUNS = {64: 256, 160: 64}  # resolution -> cell: one cell, and more than one unit takes


@dataclass(frozen=True, slots=True)
class Scene:
    """A mesh and its runs."""

    name: str
    mesh: Path
    steps: list[Step]


def scenes(args: argparse.Namespace, folder: Path) -> Iterator[Scene]:
    """Each mesh of the ladder, written when it is its turn and removed after it."""
    ladder: Ladder = LADDERS[args.size]
    if args.mesh:
        ladder = replace(ladder, resolutions={}, span=())
    if args.triangles is not None:
        held = ladder.resolutions
        ladder = replace(ladder, resolutions={n: held.get(n, ()) for n in args.triangles})
    if args.resolutions is not None:
        asked = dict.fromkeys(ladder.resolutions, tuple(args.resolutions))
        ladder = replace(ladder, resolutions=asked)
    for option in ("edges", "span"):
        if (given := getattr(args, option)) is not None:
            ladder = replace(ladder, **{option: tuple(given)})
    for path in args.mesh:
        yield Scene(path.name, path, [Step(found) for found in args.resolutions or [1024]])
    for triangles in ladder.resolutions:
        if steps := ladder.steps(triangles):
            count = Sphere.of_triangles(triangles).triangle_count
            mesh = (args.meshes or folder) / f"sphere-{count}.ply"
            if not mesh.exists():
                write_sphere(mesh, triangles)
            yield Scene(f"sphere {count:,}", mesh, steps)
            if args.meshes is None:
                mesh.unlink()
    if ladder.span:
        write_triangle(folder / "triangle.ply")
        steps = [Step(resolution) for resolution in ladder.span]
        yield Scene("one triangle", folder / "triangle.ply", steps)


def warm(place: Place) -> tuple[float, dict[str, float]]:
    """CPU seconds of compiling what the cache of kernels lacks, and of each way to start."""
    mesh, stream = place.folder / "tiny.ply", place.folder / "tiny.gst"
    write_sphere(mesh, TINY_TRIANGLES)
    found = []
    for _ in range(2):
        made = [runs.ingest(place, "tiny", mesh, stream)]
        for resolution, cell in TINY_RUNS.items():
            made.append(runs.voxelize(place, "tiny", stream, resolution, cell=cell))
        found.append({run.start: run.cpu_s for run in made})
    compiling = sum(found[0].values()) - sum(found[1].values())
    return max(0.0, compiling), found[1]


def climb(args: argparse.Namespace, place: Place, result: Result, peers: Peers) -> None:
    """Make every run; what fails is listed, and the next one follows."""

    def add(run: Run) -> None:
        result.runs.append(run)
        print(f"{label(run)}: {run.cpu_s:.1f} CPU s", file=sys.stderr)
        result.write(args.output)

    def fail(said: object) -> None:
        result.failures.append(" ".join(str(said).split()))
        print(result.failures[-1], file=sys.stderr)
        result.write(args.output)

    stream = place.folder / "scene.gst"
    for scene in scenes(args, place.folder):
        try:
            add(runs.ingest(place, scene.name, scene.mesh, stream))
        except CommandFailed as error:
            fail(error)
            continue
        for step in scene.steps:
            try:
                run = runs.voxelize(place, scene.name, stream, step.resolution, step.edge)
            except CommandFailed as error:
                fail(error)
                continue
            add(run)
            if run.voxels <= peers.voxels and step.edge is None:
                found = peers.measure(scene.mesh, step.resolution, place.folder)
                result.peers += [row | {"ours": run} for row in found]
                result.write(args.output)
        stream.unlink()


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    add = parser.add_argument
    add("--size", choices=sorted(LADDERS), default="small")
    add("--triangles", type=int, nargs="*", help="of the spheres, not the ladder's")
    add("--edges", type=float, nargs="*", help="in voxels")
    add("--resolutions", type=int, nargs="*", help="of every sphere and --mesh")
    add("--span", type=int, nargs="*", help="resolutions of one triangle across its scene")
    add("--mesh", type=Path, action="append", default=[], help="instead of the ladder's meshes")
    add("--sep", default="conservative", help="what the peers make  [conservative]")
    add("--workers", type=int, default=os.cpu_count())
    add("--memory", default="2GiB")
    add("--tmp", type=Path, help="folder for meshes, scratch and outputs")
    add("--meshes", type=Path, help="keep the generated meshes here, and take them from here")
    add("--fresh-cache", action="store_true", help="compile all kernels anew, to time that")
    add("-o", "--output", type=Path, default=Path("build/bench"), help="folder of the results")
    add("--peers", default="", help="open3d,trimesh: at the ladder's resolutions, not its edges")
    add("--peer-python", action="append", default=[], help="an interpreter that has them")
    add("--command", action="append", default=[], help="'prog {mesh} {resolution} {output}'")
    add("--peer-seconds", type=float, default=600, help="a peer is killed after that  [600]")
    add("--peer-memory", type=float, default=8, help="address space of a library, GiB  [8]")
    add("--peer-voxels", type=int, default=30_000_000, help="peers make no more  [30 M]")
    return parser.parse_args()


def main() -> None:
    args = parse()
    peers, memory = Peers.of(args), Size().convert(args.memory, None, None)
    for made in filter(None, (args.output, args.tmp, args.meshes)):
        made.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="gstream-bench-", dir=args.tmp) as name:
        place = Place(Path(name), args.sep, args.workers, args.memory)
        if args.fresh_cache:
            os.environ["NUMBA_CACHE_DIR"] = f"{name}/kernels"
        settings: dict[str, Any] = {key: getattr(args, key) for key in ("sep", "workers", "memory")}
        result = Result(machine(), settings, memory, measure_disk(place.folder), *warm(place))
        climb(args, place, result, peers)
    print(result.markdown())


if __name__ == "__main__":
    main()
