"""What the formats cost: bytes per triangle beside other formats; CPU to decode and to check.

`python -m tests.bench.bench_formats SCAN...`. One process, kernels loaded before. Decoding and
checking stand beside the copying of memory in the same run.
"""

import argparse
import io
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np

from gstream.check import check_file
from gstream.compiled import compiled
from gstream.read import open_block_file
from gstream.readers import open_mesh
from tests.bench.process import expect, machine, markdown

ROUNDS = 3
STREAMS = {
    "default": (),
    "--order spatial": ("--order", "spatial"),
    "--compact": ("--compact",),
}
RESOLUTION = 2048
BLOCKS = (64, 128)


def sizes(scan: Path, folder: Path) -> dict[str, Any]:
    """Bytes per triangle of one scan in each format, positions as float32 in all of them."""
    found: dict[str, float] = {}
    triangles = 0
    for name, options in STREAMS.items():
        stream = folder / "scan.gst"
        expect("ingest", scan, "-o", stream, *options, "--force")
        triangles = int(json.loads(expect("info", stream, "--json").out)["triangles"])
        found[f"stream {name}"] = stream.stat().st_size / triangles
    points, faces = indexed(scan, folder)
    ply = binary_ply(points, faces)
    found["binary PLY"] = len(ply) / triangles
    found["PLY + LZ4"] = len(lz4.frame.compress(ply)) / triangles
    found["OBJ"] = len(obj(points, faces)) / triangles
    return {"scan": scan.name, "triangles": triangles, **found}


def indexed(scan: Path, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) f4 vertices and (m, 3) i4 triangles of a mesh in the order of its file."""
    mesh = open_mesh(scan, lambda name: folder / name)
    points = mesh.positions.map().reshape(-1, 3).astype("<f4")
    if mesh.triangles is None:
        return points, np.arange(len(points), dtype="<i4").reshape(-1, 3)
    return points, mesh.triangles.map().astype("<i4")


def binary_ply(points: np.ndarray, faces: np.ndarray) -> bytes:
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, faces
    return head.encode() + points.tobytes() + rows.tobytes()


def obj(points: np.ndarray, faces: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.savetxt(out, points, fmt="v %.9g %.9g %.9g")
    np.savetxt(out, faces + 1, fmt="f %d %d %d")
    return out.getvalue()


def speeds(path: Path) -> list[str]:
    """CPU of decoding all blocks, with normals and positions, and of `gstream check`, compiled."""
    voxels, decoded, blocks = 0, 0, 0
    with open_block_file(path, choose=compiled) as scene:
        for level in range(scene.levels):
            for block in scene.blocks(level):
                blocks += 1
                voxels += block.count
                decoded += block.count * (3 + 1 + 4)  # place, mask, two codes of the normal

        def decode(*names: str) -> None:
            for level in range(scene.levels):
                for block in scene.blocks(level, names):
                    for name in names:
                        block.column(name)

        place = cpu(lambda: decode("occupancy"))
        normal = cpu(lambda: decode("occupancy", "normal"))
        everything = cpu(lambda: decode("occupancy", "mask", "normal"))
    checked = cpu(lambda: check_file(path, choose=compiled))
    memory = np.ones(1 << 28, np.uint8)
    copied = cpu(lambda: memory.copy())
    return [
        f"{voxels / blocks:,.0f}",
        *(f"{voxels / seconds / 1e6:.1f}" for seconds in (place, normal, everything)),
        f"{decoded / checked / 1e6:.0f}",
        f"{memory.nbytes / copied / 1e9:.1f}",
    ]


SPEEDS = (
    "block", "voxels in one", "places, M voxels/s", "and normals", "all columns",
    "check, MB/s of decoded data", "copying memory, GB/s",
)  # fmt: skip


def cpu(act: Callable[[], object]) -> float:
    """CPU seconds of the fastest round; the first, which loads kernels, is not counted."""
    found = []
    for _ in range(1 + ROUNDS):
        before = time.process_time()
        act()
        found.append(time.process_time() - before)
    return min(found[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scans", type=Path, nargs="+")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gstream-bench-") as name:
        folder = Path(name)
        rows = [sizes(scan, folder) for scan in args.scans]
        found = []
        for edge in BLOCKS:
            output, where = folder / f"{edge}.gsb", ("--resolution", RESOLUTION, "--block", edge)
            expect("build", args.scans[0], "-o", output, *map(str, where), "--sep", "6")
            found.append([f"{edge}^3", *speeds(output)])
    head = list(rows[0])
    mean = {name: sum(row[name] for row in rows) / len(rows) for name in head[2:]}
    cells = [
        [row["scan"], row["triangles"], *(f"{row[name]:.2f}" for name in head[2:])]
        for row in [*rows, {"scan": "mean", "triangles": "", **mean}]
    ]
    print(machine())
    print("\nBytes per triangle:\n")
    print(markdown(head, cells), end="\n\n")
    print(f"{args.scans[0].name} at {RESOLUTION}^3:\n")
    print(markdown(list(SPEEDS), found))


if __name__ == "__main__":
    main()
