"""Small meshes for tests that run the program: arrays here, files by `write_ply`."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def sphere(rings: int = 60, radius: float = 1.0) -> tuple[Floats, Ints]:
    """Vertices (n, 3) and 4 * rings^2 triangles (m, 3) of a closed sphere about the origin."""
    turns = 2 * rings
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rings + 1),
        np.linspace(0, 2 * np.pi, turns, endpoint=False),
        indexing="ij",
    )
    points = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    ring, turn = np.meshgrid(np.arange(rings), np.arange(turns), indexing="ij")
    a, b = ring * turns + turn, ring * turns + (turn + 1) % turns
    c, d = a + turns, b + turns
    quads = np.stack([np.stack([a, c, b], -1), np.stack([b, c, d], -1)], axis=-2)
    return radius * points.reshape(-1, 3), quads.reshape(-1, 3)


def write_ply(path: Path, points: Floats, triangles: Ints) -> Path:
    """Binary little-endian PLY with float positions."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), [("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, triangles
    path.write_bytes(header.encode() + points.astype("<f4").tobytes() + faces.tobytes())
    return path


def write_coloured_ply(
    path: Path, points: Floats, colours: NDArray[np.uint8], triangles: Ints
) -> Path:
    """Binary little-endian PLY with double positions and RGB vertex colours."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    vertices = np.empty(len(points), [("p", "<f8", 3), ("c", "u1", 3)])
    vertices["p"], vertices["c"] = points, colours
    faces = np.empty(len(triangles), [("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, triangles
    path.write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())
    return path
