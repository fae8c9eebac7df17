"""Meshes for the benchmarks, written as binary PLY piece by piece: rough sphere, huge triangle.

`python -m tests.bench.meshes sphere --triangles 10_000_000 -o x.ply`. Same arguments, same bytes.
"""

import argparse
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BAND = 64  # grid rows generated at once
TILE = 64  # quads per edge of a patch of the triangle order: a scan is local, not one long strip
OCTAVES = 7
LATTICE = 64  # period of the noise table
FIRST_FREQUENCY = 2.0  # noise cells per sphere radius in the first octave
RELIEF = 0.12  # amplitude of the first octave in sphere radii; each next one has 0.55 of it
FALL = 0.55
ROUGHNESS = 0.25  # white noise, in edges


@dataclass(frozen=True)
class Sphere:
    """A closed displaced sphere: an m x m grid of quads folded onto the sphere, 2 m^2 triangles.

    The square's border is folded so that (0, j) is (0, m-j), and likewise on the other three sides;
    m is even. Source of the map: Clarberg, Fast Equal-Area Mapping of the (Hemi)Sphere (2008).
    """

    m: int
    seed: int = 1

    @classmethod
    def of_triangles(cls, triangles: int, seed: int = 1) -> "Sphere":
        """The sphere whose triangle count is nearest to `triangles`."""
        half = max(2, round((triangles / 8) ** 0.5))
        return cls(2 * half, seed)

    @property
    def triangle_count(self) -> int:
        return 2 * self.m * self.m

    @property
    def vertex_count(self) -> int:
        return self.m * self.m + 2

    @cached_property
    def noise(self) -> Floats:
        return np.random.default_rng([self.seed, 0]).uniform(-1, 1, (LATTICE,) * 3)

    @cached_property
    def row_start(self) -> Ints:
        """The id of the first vertex that row i owns, (m + 2,)."""
        m = self.m
        owned = np.full(m + 1, m + 1)
        owned[m // 2 + 1 :] = m - 1
        owned[0], owned[m] = m // 2 + 1, m // 2
        return np.concatenate(([0], np.cumsum(owned)))

    def row_ids(self, i: int) -> Ints:
        """Vertex ids of the m + 1 places of row i, folded ones included."""
        m, start = self.m, self.row_start
        place = np.arange(m + 1)
        if i == 0:
            return np.minimum(place, m - place)
        if i == m:
            ids = start[m] + np.minimum(place, m - place) - 1
            ids[[0, m]] = 0
            return ids
        if i <= m // 2:
            return start[i] + place
        ids = start[i] + place - 1
        ids[0], ids[m] = start[m - i], start[m - i] + m
        return ids

    def vertices(self, first: int, stop: int) -> NDArray[np.float32]:
        """Positions of the vertices that rows first..stop own, (n, 3) float32."""
        m = self.m
        rows, columns = [], []
        for i in range(first, stop):
            owned = int(self.row_start[i + 1] - self.row_start[i])
            column = np.arange(owned) + (1 if i > m // 2 else 0)
            columns.append(column)
            rows.append(np.full(owned, i))
        u, v = np.concatenate(rows), np.concatenate(columns)
        direction = _unfold(u * (2 / m) - 1, v * (2 / m) - 1)
        edge = (4 * np.pi / self.m**2) ** 0.5
        jitter = np.random.default_rng([self.seed, 1, first]).uniform(-1, 1, direction.shape)
        moved = direction + jitter * (ROUGHNESS * edge)
        return np.asarray(moved * (1 + self._relief(direction))[:, None], np.float32)

    def _relief(self, direction: Floats) -> Floats:
        total = np.zeros(len(direction))
        for octave in range(OCTAVES):
            place = direction * (FIRST_FREQUENCY * 2**octave) + 17.3 * (octave + 1)
            total += RELIEF * FALL**octave * _value_noise(self.noise, place)
        return total

    def faces(self, first: int, stop: int) -> NDArray[np.int32]:
        """Triangles of quad rows first..stop, patch by patch, (n, 3) int32, facing outward."""
        ids = np.stack([self.row_ids(i) for i in range(first, stop + 1)])
        a, b, c, d = ids[:-1, :-1], ids[:-1, 1:], ids[1:, :-1], ids[1:, 1:]
        falling = self._diagonals(first, stop)
        one = np.where(falling[..., None], np.stack([a, c, d], -1), np.stack([a, c, b], -1))
        two = np.where(falling[..., None], np.stack([a, d, b], -1), np.stack([b, c, d], -1))
        quads = np.stack([one, two], axis=2)
        patches = [quads[:, x : x + TILE].reshape(-1, 3) for x in range(0, self.m, TILE)]
        return np.concatenate(patches).astype(np.int32)

    def _diagonals(self, first: int, stop: int) -> NDArray[np.bool_]:
        """True where a quad is cut from its first corner; random but for the border."""
        m = self.m
        falling = np.random.default_rng([self.seed, 2, first]).random((stop - first, m)) < 0.5
        i, j = np.arange(first, stop)[:, None], np.arange(m)[None, :]
        # two quads at the middle of a side share three corners: only the fold's diagonal fits both
        border = (i == 0) | (j == 0) | (i == m - 1) | (j == m - 1)
        return np.where(border, (i < m // 2) != (j < m // 2), falling)


def _unfold(u: Floats, v: Floats) -> Floats:
    """The square [-1, 1]^2 onto the unit sphere, equal areas; (n,), (n,) -> (n, 3)."""
    d = 1 - np.abs(u) - np.abs(v)
    r = 1 - np.abs(d)
    turn = np.divide(np.abs(v) - np.abs(u), r, out=np.zeros_like(r), where=r > 0)
    phi = np.pi / 4 * (turn + 1)
    flat = r * np.sqrt(2 - r * r)
    x, y = np.copysign(np.cos(phi) * flat, u), np.copysign(np.sin(phi) * flat, v)
    return np.stack([x, y, np.copysign(1 - r * r, d)], axis=1)


def _value_noise(table: Floats, place: Floats) -> Floats:
    """Smoothly interpolated lattice noise in [-1, 1]: Perlin's fade curve on a periodic table."""
    corner = np.floor(place)
    t = place - corner
    t = t * t * t * (t * (t * 6 - 15) + 10)
    low = corner.astype(np.int64) % LATTICE
    high = (low + 1) % LATTICE
    total = np.zeros(len(place))
    for bits in range(8):
        index, weight = [], np.ones(len(place))
        for axis in range(3):
            up = bits >> axis & 1
            index.append((high if up else low)[:, axis])
            weight *= t[:, axis] if up else 1 - t[:, axis]
        total += weight * table[index[0], index[1], index[2]]
    return total


def write_header(file: BinaryIO, vertices: int, faces: int) -> None:
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {vertices}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {faces}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    file.write(("\n".join(lines) + "\n").encode())


def write_faces(file: BinaryIO, faces: NDArray[np.int32]) -> None:
    record = np.empty(len(faces), dtype=[("n", "u1"), ("ids", "<i4", 3)])
    record["n"], record["ids"] = 3, faces
    file.write(record.tobytes())


def write_sphere(path: Path, triangles: int, seed: int = 1) -> Sphere:
    """Write the sphere nearest to `triangles` triangles; memory is a band of rows."""
    sphere = Sphere.of_triangles(triangles, seed)
    with open(path, "wb") as file:
        write_header(file, sphere.vertex_count, sphere.triangle_count)
        for first in range(0, sphere.m + 1, BAND):
            file.write(sphere.vertices(first, min(first + BAND, sphere.m + 1)).tobytes())
        for first in range(0, sphere.m, BAND):
            write_faces(file, sphere.faces(first, min(first + BAND, sphere.m)))
    return sphere


def write_triangle(path: Path) -> None:
    """Write one triangle that spans its scene and lies along no axis."""
    corners = np.array([[0, 0.02, 0.1], [1, 0.31, 0.93], [0.27, 1, 0.5]], "<f4")
    with open(path, "wb") as file:
        write_header(file, 3, 1)
        file.write(corners.tobytes())
        write_faces(file, np.array([[0, 1, 2]], np.int32))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shape", choices=["sphere", "triangle"])
    parser.add_argument("--triangles", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    if args.shape == "triangle":
        write_triangle(args.output)
        print(f"{args.output}: 1 triangle")
        return
    sphere = write_sphere(args.output, args.triangles, args.seed)
    print(f"{args.output}: {sphere.triangle_count} triangles, {sphere.vertex_count} vertices")


if __name__ == "__main__":
    main()
