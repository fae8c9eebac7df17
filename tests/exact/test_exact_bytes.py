"""208 random meshes through the whole program: what must not change the file changes no byte.

12 of them in the quick part. Each mesh has a few triangles of every other kind of scenes.py, some
that share corners, and settings by chance.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from exact import oracle, scenes
from numpy.typing import NDArray

import gstream

QUICK, ALL = 12, 208
EVERY_SEED = [
    pytest.param(seed, marks=pytest.mark.long) if seed >= QUICK else seed for seed in range(ALL)
]
SNAP_BITS, EDGE = 6, 16


@dataclass(frozen=True, slots=True)
class Mesh:
    vertices: NDArray[Any]  # (n,) records: position, and colour and normal where it has them
    triangles: NDArray[np.int64]  # (m, 3)
    settings: dict[str, Any]


def random_mesh(seed: int) -> Mesh:
    random, rng = Random(seed), np.random.default_rng(seed)
    kinds = random.choices(list(scenes.KINDS), k=random.randint(2, 20))
    soup = np.concatenate(
        [scenes.soup(kind, seed, 1, SNAP_BITS, (0, 0, 0), EDGE) for kind in kinds]
    )
    voxel = random.choice([1.0, 0.1, 1 / 3])
    coloured, normals = random.random() < 0.7, random.random() < 0.3
    fields: list[Any] = [("position", "<f8", 3)]
    fields += [("colour", "u1", 3)] * coloured + [("normal", "<f4", 3)] * normals
    vertices = np.zeros(soup.size // 3, fields)
    vertices["position"] = soup.reshape(-1, 3) / 2**SNAP_BITS * voxel
    if coloured:
        vertices["colour"] = rng.integers(0, 256, (len(vertices), 3))
    if normals:
        vertices["normal"] = rng.normal(size=(len(vertices), 3))
    alone = np.arange(len(vertices)).reshape(-1, 3)
    sharing = rng.integers(0, len(vertices), (random.randint(0, 8), 3))
    settings = {
        "sep": random.choice(oracle.SEPARATIONS),
        "ties": random.choice(oracle.TIES),
        "snap_bits": random.choice([None, 2, SNAP_BITS, 9]),
        "faces": random.choice(["front", "both"]),
        "normals": "input" if normals and random.random() < 0.7 else "geometric",
        "keep_weights": True,
    }
    # Voxels of the soup's own lattice, on which ties abound, or a grid around what there is.
    size = {"voxel_size": voxel} if random.random() < 0.6 else {"resolution": random.randint(9, 70)}
    return Mesh(vertices, np.concatenate([alone, sharing]), {**settings, **size})


def build(mesh: Mesh, folder: Path, ingest: dict[str, Any] | None = None, **more: Any) -> Path:
    names = {
        "position": [f"double {axis}" for axis in "xyz"],
        "colour": [f"uchar {channel}" for channel in ("red", "green", "blue")],
        "normal": [f"float n{axis}" for axis in "xyz"],
    }
    lines = [f"element vertex {len(mesh.vertices)}"]
    lines += [f"property {p}" for name in mesh.vertices.dtype.names for p in names[name]]
    lines += [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices"]
    header = "\n".join(["ply", "format binary_little_endian 1.0", *lines, "end_header\n"])
    faces = np.zeros(len(mesh.triangles), [("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, mesh.triangles
    path, output = folder / "mesh.ply", folder / "out.gsb"
    path.write_bytes(header.encode() + mesh.vertices.tobytes() + faces.tobytes())
    settings = {"block": 8, "cell": 256, "workers": 0, "force": True, **mesh.settings, **more}
    gstream.build(path, output, ingest=ingest, **settings)
    return output


def shuffled(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """The triangles in another order, and so the vertices."""
    order = rng.permutation(len(mesh.vertices))
    triangles = np.argsort(order)[rng.permutation(mesh.triangles)]
    return replace(mesh, vertices=mesh.vertices[order], triangles=triangles)


def turned(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Each triangle from a corner by chance."""
    places = (np.arange(3) + rng.integers(0, 3, (len(mesh.triangles), 1))) % 3
    return replace(mesh, triangles=np.take_along_axis(mesh.triangles, places, axis=1))


@pytest.mark.parametrize("seed", EVERY_SEED)
def test_order_corners_chunks_cells_and_workers_change_no_byte(tmp_path, seed):
    mesh, random, rng = random_mesh(seed), Random(seed), np.random.default_rng(seed + 1)
    wanted = build(mesh, tmp_path).read_bytes()
    chunks = {"chunk_triangles": random.randint(1, 9), "order": random.choice(["file", "spatial"])}
    assert build(shuffled(mesh, rng), tmp_path).read_bytes() == wanted
    assert build(turned(mesh, rng), tmp_path).read_bytes() == wanted
    assert build(mesh, tmp_path, ingest=chunks).read_bytes() == wanted
    assert build(mesh, tmp_path, cell=random.choice([8, 16, 32])).read_bytes() == wanted
    if seed % 26 == 0:  # processes take seconds to start
        assert build(mesh, tmp_path, workers=2, cell=8).read_bytes() == wanted


def voxels(path: Path) -> list[NDArray[np.uint32]]:
    """Per level: rows of place, mask, normal, weight and colour of its voxels, in order."""
    levels = []
    with gstream.open(path) as file:
        for level in range(file.levels):
            rows = []
            for view in file.blocks(level):
                columns = [view.positions(), view.mask[:, None], view.normal_codes]
                columns.append(view.weight[:, None])
                if "colour" in file.columns:
                    columns.append(view.colour)
                rows.append(np.concatenate(columns, axis=1, dtype=np.uint32))
            found = np.concatenate(rows)
            levels.append(found[np.lexsort(found.T)])
    return levels


@pytest.mark.parametrize("seed", EVERY_SEED)
def test_blocks_of_any_size_hold_the_same_voxels_with_the_same_bytes(tmp_path, seed):
    mesh, block = random_mesh(seed), Random(seed).choice([16, 32, 64])
    small, large = (voxels(build(mesh, tmp_path, block=edge)) for edge in (8, block))
    assert len(small) >= len(large)  # the last level is one block
    for one, other in zip(small, large, strict=False):
        np.testing.assert_array_equal(one, other)
