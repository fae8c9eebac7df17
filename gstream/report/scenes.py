"""Analytic scenes: a mesh, and the surface it stands for, known exactly. Nothing of a kernel's.

A mesh of flat triangles is not the curved surface: `floor` says how far it is from it at most, so
that no error below that is blamed on the voxels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, pi, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Nearest = Callable[[Floats], tuple[Floats, Floats]]

SAMPLES = 4096
PLANES = 4  # rectangles along each axis
RING, TUBE = 1.0, 0.4  # radii of the torus


@dataclass(frozen=True, slots=True)
class Scene:
    """A mesh and its true surface, in world units."""

    name: str
    points: Floats  # (n, 3) vertices
    triangles: Ints  # (m, 3) vertices of each, anticlockwise from outside
    nearest: Nearest  # (k, 3) points -> (k,) distance to the surface, (k, 3) unit normal there
    samples: Floats  # (k, 3) points of the surface, evenly spread
    area: float  # of the surface

    @property
    def floor(self) -> float:
        """The mesh's own distance from the surface: its largest at the middles of its edges.

        The triangles are right-angled or nearly so: the middle of the longest edge is furthest out.
        """
        corners = self.points[self.triangles]
        middles = (corners + np.roll(corners, 1, axis=1)) / 2
        return float(self.nearest(middles.reshape(-1, 3))[0].max())


def planes(resolution: int) -> Scene:
    """64 rectangles, each at an angle of its own; flat, so that the mesh is the surface."""
    pitch = 1 / PLANES
    sites = (np.indices((PLANES,) * 3).reshape(3, -1).T + 0.5) * pitch
    first, second, normal = _frames(len(sites))
    half = pitch / 4  # the corners stay 0.29 pitch away from the neighbours' at any angle
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    spanned = signs[:, :1] * first[:, None] + signs[:, 1:] * second[:, None]
    points = (sites[:, None] + half * spanned).reshape(-1, 3)
    quads = 4 * np.arange(len(sites))[:, None, None] + np.array([(0, 1, 2), (0, 2, 3)])

    def nearest(at: Floats) -> tuple[Floats, Floats]:
        best, owner = np.full(len(at), np.inf), np.zeros(len(at), np.int64)
        for i, site in enumerate(sites):
            local = (at - site) @ np.stack([first[i], second[i], normal[i]], axis=1)
            local[:, :2] = np.maximum(np.abs(local[:, :2]) - half, 0)
            distance = np.linalg.norm(local, axis=1)
            owner[distance < best] = i
            best = np.minimum(best, distance)
        return best, normal[owner]

    each = 2 * _spread(SAMPLES // len(sites)) - 1
    across = each[:, :1] * first[:, None] + each[:, 1:] * second[:, None]
    samples = (sites[:, None] + half * across).reshape(-1, 3)
    return Scene("planes", points, quads.reshape(-1, 3), nearest, samples, len(sites) * 4 * half**2)


def sphere(resolution: int) -> Scene:
    """The unit sphere: a cube's six faces, blown up; error below a hundredth of a voxel."""
    count = ceil(5.6 * sqrt(resolution))
    angle = np.tan(np.linspace(-pi / 4, pi / 4, count + 1))
    v, u = (part.ravel() for part in np.meshgrid(angle, angle, indexing="ij"))
    face = np.stack([u, v, np.ones_like(u)], axis=1)
    turns = [np.roll(face, axis, axis=1) for axis in range(3)]
    cube = np.concatenate([*turns, *(-turn[:, [1, 0, 2]] for turn in turns)])
    quads = _quads(count, count, count + 1)
    starts = len(face) * np.arange(6)[:, None, None]
    triangles = (starts + quads).reshape(-1, 3)
    points = cube / np.linalg.norm(cube, axis=1, keepdims=True)
    outward = _facing_out(points, triangles)

    def nearest(at: Floats) -> tuple[Floats, Floats]:
        radius = np.linalg.norm(at, axis=1)
        return np.abs(radius - 1), at / radius[:, None]

    a, b = _spread(SAMPLES).T
    ring = np.sqrt(1 - (1 - 2 * a) ** 2)
    samples = np.stack([ring * np.cos(2 * pi * b), ring * np.sin(2 * pi * b), 1 - 2 * a], axis=1)
    return Scene("sphere", points, outward, nearest, samples, 4 * pi)


def torus(resolution: int) -> Scene:
    """A ring of radius 1 and a tube of radius 0.4 about z."""
    around, across = ceil(16 * sqrt(resolution)), ceil(8.4 * sqrt(resolution))
    u = np.repeat(np.arange(around) / around, across)
    v = np.tile(np.arange(across) / across, around)
    points = _on_torus(u, v)
    i, j = (part.ravel() for part in np.meshgrid(np.arange(around), np.arange(across)))
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = i * across + (j + 1) % across, (i + 1) % around * across + (j + 1) % across
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])

    def nearest(at: Floats) -> tuple[Floats, Floats]:
        radius = np.hypot(at[:, 0], at[:, 1])
        inside = np.hypot(radius - RING, at[:, 2])
        outward = at.copy()
        outward[:, :2] *= ((radius - RING) / radius)[:, None]
        return np.abs(inside - TUBE), outward / inside[:, None]

    # dense on the inner side, thin on the outer one: for the largest distance that is no matter
    samples = _on_torus(*_spread(SAMPLES).T)
    return Scene("torus", points, triangles, nearest, samples, 4 * pi**2 * RING * TUBE)


SCENES: dict[str, Callable[[int], Scene]] = {"planes": planes, "sphere": sphere, "torus": torus}


def write_ply(scene: Scene, path: Path) -> None:
    """Binary little-endian PLY with double positions, so that the vertices are exact."""
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(scene.points)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(scene.triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(scene.triangles), [("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, scene.triangles
    path.write_bytes(header.encode() + scene.points.astype("<f8").tobytes() + faces.tobytes())


def _spread(count: int) -> Floats:
    """(count, 2) points of the unit square, evenly spread and always the same.

    source : R2, M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018
    """
    plastic = 1.324717957244746
    return np.mod((np.arange(count)[:, None] + 0.5) * [1 / plastic, 1 / plastic**2], 1.0)


def _frames(count: int) -> tuple[Floats, Floats, Floats]:
    """(count, 3) each: right-handed orthonormal frames with evenly spread normals."""
    a, b = _spread(count).T
    ring = np.sqrt(1 - (1 - 2 * a) ** 2)
    normal = np.stack([ring * np.cos(2 * pi * b), ring * np.sin(2 * pi * b), 1 - 2 * a], axis=1)
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(least, normal)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normal, first), normal


def _quads(rows: int, columns: int, stride: int) -> Ints:
    """(2 * rows * columns, 3) triangles of a lattice of vertices, `stride` to a row."""
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (row * stride + column).ravel()
    b, c, d = a + 1, a + stride, a + stride + 1
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])


def _facing_out(points: Floats, triangles: Ints) -> Ints:
    """The triangles of a shape that is convex about the origin, all anticlockwise from outside."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    inward = (np.cross(b - a, c - a) * a).sum(axis=1) < 0
    return np.where(inward[:, None], triangles[:, ::-1], triangles)


def _on_torus(u: Floats, v: Floats) -> Floats:
    """(n, 3) points at turns u about z and v about the tube."""
    radius = RING + TUBE * np.cos(2 * pi * v)
    ring = radius * np.cos(2 * pi * u), radius * np.sin(2 * pi * u)
    return np.stack([*ring, TUBE * np.sin(2 * pi * v)], axis=1)
