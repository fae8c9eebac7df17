"""What a scene is: a mesh, and the surface it stands for, known without a kernel."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Codes = NDArray[np.uint8]
Nearest = Callable[[Floats], tuple[Floats, Floats]]

SAMPLES = 4096


@dataclass(frozen=True, slots=True)
class Scene:
    """A mesh and its true surface, in world units."""

    name: str
    points: Floats  # (n, 3) vertices
    triangles: Ints  # (m, 3) vertices of each, anticlockwise from outside
    nearest: Nearest  # (k, 3) points -> (k,) distance to the surface, (k, 3) unit normal there
    samples: Floats  # (k, 3) points of the surface, evenly spread
    area: float  # of the surface
    closed: bool = False  # each edge has two triangles, once in either direction
    # (k, 3) points -> (k,) whether inside the surface moved by (e1 >> e2 >> e3 > 0); None: not
    # closed
    inside: Callable[[Floats], Bools] | None = None
    # (k, 3) points of the surface -> (k, 3) RGB in linear light, 0 to 1; None: no colour
    colour: Callable[[Floats], Floats] | None = None
    vertex_colours: Codes | None = None  # (n, 3) sRGB codes
    flat: bool = False  # the mesh is the surface

    @property
    def floor(self) -> float:
        """The mesh's own distance from the surface: its largest at the middles of its edges.

        The triangles are right-angled or nearly so: the middle of the longest edge is furthest out.
        """
        if self.flat:
            return 0.0
        corners = self.points[self.triangles]
        middles = (corners + np.roll(corners, 1, axis=1)) / 2
        return float(self.nearest(middles.reshape(-1, 3))[0].max())


def write_ply(scene: Scene, path: Path) -> None:
    """Binary little-endian PLY with double positions, so that the vertices are exact."""
    channels = () if scene.vertex_colours is None else ("red", "green", "blue")
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(scene.points)}\n"
        + "".join(f"property double {axis}\n" for axis in "xyz")
        + "".join(f"property uchar {channel}\n" for channel in channels)
        + f"element face {len(scene.triangles)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    vertices = np.empty(len(scene.points), [("at", "<f8", 3), ("colour", "u1", len(channels))])
    vertices["at"] = scene.points
    if scene.vertex_colours is not None:
        vertices["colour"] = scene.vertex_colours
    faces = np.empty(len(scene.triangles), [("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, scene.triangles
    path.write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())


def spread(count: int) -> Floats:
    """(count, 2) points of the unit square, evenly spread and always the same.

    source : R2, M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018
    """
    plastic = 1.324717957244746
    return np.mod((np.arange(count)[:, None] + 0.5) * [1 / plastic, 1 / plastic**2], 1.0)


def spread_on(corners: Floats, count: int) -> Floats:
    """(count, 3) points of (m, 3, 3) triangles, as many to an area everywhere."""
    a, b, c = corners.transpose(1, 0, 2)
    until = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    owner = np.searchsorted(until, (np.arange(count) + 0.5) / count * until[-1])
    u, v = spread(count).T
    beyond = u + v > 1  # in the other half of the parallelogram
    u, v = np.where(beyond, 1 - u, u)[:, None], np.where(beyond, 1 - v, v)[:, None]
    a, b, c = a[owner], b[owner], c[owner]
    samples: Floats = a + u * (b - a) + v * (c - a)
    return samples


def linear_of_codes(codes: Codes) -> Floats:
    """Linear light, 0 to 1, of sRGB codes (IEC 61966-2-1)."""
    part = codes / 255
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)


def codes_of_linear(light: Floats) -> Floats:
    """sRGB codes, not rounded, of linear light from 0 to 1."""
    return 255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
