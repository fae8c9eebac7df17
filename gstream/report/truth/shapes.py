"""Balls, rings and boxes: their points and triangles, and distances that are known exactly."""

from math import ceil, pi, sqrt

import numpy as np

from gstream.report.truth.scene import Floats, Ints, spread

# Corner i is high in x, y, z where bits 0, 1, 2 of i are set; triangles are seen from outside.
BOX_CORNERS = np.indices((2, 2, 2)).reshape(3, 8).T[:, ::-1]
BOX_QUADS = np.array(
    [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
)
BOX_TRIANGLES = np.concatenate([BOX_QUADS[:, [0, 1, 2]], BOX_QUADS[:, [0, 2, 3]]])


def directions(count: int) -> Floats:
    """(count, 3) unit vectors, evenly spread."""
    a, b = spread(count).T
    ring = np.sqrt(1 - (1 - 2 * a) ** 2)
    return np.stack([ring * np.cos(2 * pi * b), ring * np.sin(2 * pi * b), 1 - 2 * a], axis=1)


def frames(count: int) -> tuple[Floats, Floats, Floats]:
    """(count, 3) each: right-handed orthonormal frames with evenly spread normals."""
    normal = directions(count)
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(least, normal)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normal, first), normal


def ball(resolution: int) -> tuple[Floats, Ints]:
    """Points of the unit sphere, each once, and triangles that are anticlockwise from outside."""
    count = ceil(5.6 * sqrt(resolution))
    angle = np.tan(np.linspace(-pi / 4, pi / 4, count + 1))
    angle = (angle - angle[::-1]) / 2  # the faces' borders are equal to the bit
    angle[0], angle[-1] = -1, 1
    v, u = (part.ravel() for part in np.meshgrid(angle, angle, indexing="ij"))
    face = np.stack([u, v, np.ones_like(u)], axis=1)
    turns = [np.roll(face, axis, axis=1) for axis in range(3)]
    cube, number = np.unique(
        np.concatenate([*turns, *(-turn for turn in turns)]) + 0.0, axis=0, return_inverse=True
    )
    starts = len(face) * np.arange(6)[:, None, None]
    triangles = number[(starts + _quads(count)).reshape(-1, 3)]
    points = cube / np.linalg.norm(cube, axis=1, keepdims=True)
    a, b, c = points[triangles].transpose(1, 0, 2)
    inward = (np.cross(b - a, c - a) * a).sum(axis=1) < 0
    return points, np.where(inward[:, None], triangles[:, ::-1], triangles)


def _quads(count: int) -> Ints:
    """(2 * count^2, 3) triangles of a lattice of (count + 1)^2 vertices."""
    row, column = np.indices((count, count)).reshape(2, -1)
    a = row * (count + 1) + column
    b, c, d = a + 1, a + count + 1, a + count + 2
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])


def ring(around: int, across: int, ring: float, tube: float) -> tuple[Floats, Ints]:
    """Points and triangles of a torus about z."""
    i, j = np.indices((around, across)).reshape(2, -1)
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = i * across + (j + 1) % across, (i + 1) % around * across + (j + 1) % across
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    return on_ring(np.stack([i / around, j / across], axis=1), ring, tube), triangles


def on_ring(turns: Floats, ring: float, tube: float) -> Floats:
    """(n, 3) points of a torus at (n, 2) turns, about z and about the tube."""
    u, v = turns.T
    radius = ring + tube * np.cos(2 * pi * v)
    flat = radius * np.cos(2 * pi * u), radius * np.sin(2 * pi * u)
    return np.stack([*flat, tube * np.sin(2 * pi * v)], axis=1)


def from_circle(at: Floats, ring: float) -> tuple[Floats, Floats]:
    """(n,) distance from a circle about z, (n, 3) the way from it."""
    radius = np.hypot(at[:, 0], at[:, 1])
    distance = np.hypot(radius - ring, at[:, 2])
    outward = at.copy()
    outward[:, :2] *= ((radius - ring) / radius)[:, None]
    return distance, outward / distance[:, None]


def from_box(at: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """(n,) distance from a box's surface, (n, 3) the normal there; of an edge, one of the two."""
    from_middle = at - (low + high) / 2
    beyond = np.abs(from_middle) - (high - low) / 2
    most = beyond.max(axis=1)
    distance = np.where(most > 0, np.linalg.norm(np.maximum(beyond, 0), axis=1), -most)
    facing = np.eye(3)[beyond.argmax(axis=1)]
    return distance, facing * np.sign(from_middle)
