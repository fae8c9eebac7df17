"""Ingest of one mesh, stage by stage: CPU per triangle, bytes per triangle, and reading it back.

`python -m tests.bench.bench_ingest --triangles 4_000_000` or `--mesh a.ply`. One process, kernels
compiled before; CPU is user and system time of this process, fsync included. The best of --rounds.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gstream.errors import GstreamError
from gstream.formats.stream import StreamReader
from gstream.formats.stream_chunk import KNOWN
from gstream.formats.stream_parts import encode_chunk
from gstream.job import IngestSettings, Job
from gstream.kernels import indexing
from gstream.readers import open_mesh
from gstream.readers.mesh import Mesh
from gstream.stages import ingest
from gstream.stages.slicing import Slice, chunks_of, slice_of
from tests.bench.meshes import Sphere, write_sphere
from tests.bench.process import machine, markdown


@dataclass(frozen=True, slots=True)
class Bench:
    """A mesh that was opened, in a folder of its own."""

    folder: Path
    mesh: Mesh
    settings: IngestSettings

    @property
    def job(self) -> Job:
        stream = str(self.folder / "x.gst")
        return Job(str(self.folder), str(self.folder / "x.gsb"), stream, self.settings)

    def slice(self, source: int, first: int, count: int) -> Slice:
        order = "file" if self.settings.order == "file" else "spatial"
        return slice_of(self.mesh, source, first, count, order)


def nanoseconds(act: Callable[[], object], triangles: int, rounds: int) -> float:
    """CPU per triangle of the fastest round."""
    found = []
    for _ in range(rounds):
        before = time.process_time()
        act()
        found.append(time.process_time() - before)
    return min(found) / triangles * 1e9


def opened(folder: Path, path: Path, settings: IngestSettings) -> Bench:
    (folder / "1-spill").mkdir(exist_ok=True)
    mesh = open_mesh(path, lambda name: folder / name)
    (folder / "1-spill" / "0.json").write_bytes(mesh.to_json())
    return Bench(folder, mesh, settings)


def work(bench: Bench) -> None:
    for unit in ingest.plan(bench.job):
        ingest.work(bench.job, unit)


def slices(bench: Bench) -> None:
    for unit in ingest.plan(bench.job):
        for _ in chunks_of(bench.slice(*unit.data), bench.settings.chunk_triangles):
            pass


def encode(chunks: Iterable[object], lz4: str) -> None:
    for chunk in chunks:
        encode_chunk(chunk, lz4, indexing)  # type: ignore[arg-type]


def read(path: str) -> None:
    reader = StreamReader(path, indexing)
    for index in range(len(reader.chunks)):
        reader.chunk(index)


def figures(bench: Bench, rounds: int) -> list[list[object]]:
    """CPU of each step, ns per triangle and million triangles per CPU second."""
    count, job = bench.mesh.triangle_count, bench.job
    ingest.warm()
    with open(bench.mesh.name, "rb") as file:
        while file.read(1 << 24):  # into the page cache: disks are not what is measured
            pass
    first = bench.slice(0, 0, min(count, 1 << 20))
    sample = list(chunks_of(first, bench.settings.chunk_triangles))
    encode(sample[:1], "fast")
    some = sum(chunk.triangle_count for chunk in sample)
    steps = [
        ("slice: read, index, gather", nanoseconds(lambda: slices(bench), count, rounds)),
        ("encode fast", nanoseconds(lambda: encode(sample, "fast"), some, rounds)),
        ("encode hc", nanoseconds(lambda: encode(sample, "hc"), some, 1)),
        ("work: all of a unit", nanoseconds(lambda: work(bench), count, rounds)),
        ("finish: join the parts", nanoseconds(lambda: ingest.finish(job), count, rounds)),
    ]
    read(job.stream)
    steps.append(("read back", nanoseconds(lambda: read(job.stream), count, rounds)))
    return [[name, f"{cost:.0f}", f"{1000 / cost:.1f}"] for name, cost in steps]


def sizes(bench: Bench) -> list[list[object]]:
    """Bytes per triangle of the whole file and of each attribute."""
    reader, count = StreamReader(bench.job.stream), bench.mesh.triangle_count
    stored: dict[str, int] = {}
    for index in range(len(reader.chunks)):
        for part in reader.head(index).parts:
            name = KNOWN[part.attribute].name
            stored[name] = stored.get(name, 0) + part.stored
    rows = [["file", f"{reader.file_length / count:.2f}"]]
    rows += [[name, f"{size / count:.2f}"] for name, size in stored.items()]
    vertices = int(reader.chunks["vertices"].sum())
    return [*rows, ["vertices per triangle", f"{vertices / count:.3f}"]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--triangles", type=int, default=4_000_000)
    parser.add_argument("--mesh", type=Path, help="measure this mesh, not the generated sphere")
    parser.add_argument("--order", choices=["file", "spatial", "smallest"], default="file")
    parser.add_argument("--lz4", choices=["fast", "hc"], default="fast")
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gstream-bench-") as name, suppress(KeyboardInterrupt):
        folder, path = Path(name), args.mesh
        if path is None:
            path = folder / "sphere.ply"
            write_sphere(path, Sphere.of_triangles(args.triangles).triangle_count)
        try:
            settings = IngestSettings((str(path),), order=args.order, lz4=args.lz4)
            bench = opened(folder, path, settings)
            costs = figures(bench, args.rounds)
        except GstreamError as error:
            raise SystemExit(str(error)) from error
        print(machine())
        print(f"{path.name}: {bench.mesh.triangle_count:,} triangles\n")
        print(markdown(["step", "ns / triangle", "Mtri / CPU s"], costs), end="\n\n")
        print(markdown(["part", "bytes / triangle"], sizes(bench)))


if __name__ == "__main__":
    main()
