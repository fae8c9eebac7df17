"""The exact voxels of a mesh, found without the kernels: separating axes in NumPy.

A float64 value decides where it is farther from a tie than its error can be. Where it is not, the
value is computed again in integers. Ties are one-sided: the surface is moved by an infinitesimal
(e1 >> e2 >> e3 > 0).

A target is a zonotope about the voxel's centre, given by its generators: the voxel itself has
three, a segment has one. Target and triangle are apart iff they are so along the triangle's normal,
an edge x generator or, for the voxel, a coordinate axis; the last says that the voxel lies in the
triangle's bounding box. A segment needs no other axis, for nothing stays coplanar under the
infinitesimal: one that is parallel to the triangle, or whose triangle has no area, is not met.

Source: separating-axis theorem; S. Laine, A Topological Approach to Voxelization, CGF 32(4), 2013.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Numbers = NDArray[Any]  # float64, int64 or Python integers
Vector = tuple[int, int, int]
Generators = tuple[Vector, ...]

VOXEL: Generators = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
DIAGONALS: Generators = ((1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1))
TARGETS: dict[str, tuple[Generators, ...]] = {
    "6": tuple((axis,) for axis in VOXEL),
    "26": tuple((diagonal,) for diagonal in DIAGONALS),
    "conservative": (VOXEL,),
}
CHUNK = 1 << 15  # cells tested at once: 2^14 and 2^16 took a fourth more time
EIGHT = np.indices((2, 2, 2)).reshape(3, 8).T
KEY_BITS = 21

# With E and M the largest components of the edges and of the vertices from the centre, s the cell's
# edge and u = 2^-53: an edge x generator is wrong by 4uE in each component, its product with a
# vertex by 34uEM, the target's reach along it by 11uEs; of the normal these are 8uEE, 46uEEM and
# 17uEEs. 64 holds these, the comparison's rounding and all terms in u^2.
ERROR = 64 * 2.0**-53


def exact_voxels(corners: Floats, sep: str, low: Vector, high: Vector) -> Ints:
    """The voxels that triangles set at level 0.

    corners : (m, 3, 3) vertices in voxels, taken for exactly what they are; components are 0 or
        from 2^-200 to 2^20 in magnitude
    sep : "6" | "26" | "conservative"
    low, high : the voxels asked for, low <= voxel < high
    returns : (n, 3) voxel coordinates, sorted by x, y, z, each once
    """
    search = _Search(corners, sep, np.array(low), np.array(high))
    keys = distinct(np.concatenate([np.empty(0, np.int64), *search.keys()]))
    mask = (1 << KEY_BITS) - 1
    shifts = (2 * KEY_BITS, KEY_BITS, 0)
    found: Ints = np.stack([keys >> shift & mask for shift in shifts], axis=1) + np.array(low)
    return found


def distinct(keys: Ints) -> Ints:
    """(n,) numbers sorted, each once: numpy.unique hashes them, and takes ten times as long."""
    keys = np.sort(keys)
    first = np.ones(len(keys), np.bool_)
    first[1:] = keys[1:] != keys[:-1]
    return keys[first]


class _Search:
    """Cells of 2^level voxels that a triangle may meet, halved until they are voxels."""

    def __init__(self, corners: Floats, sep: str, low: Ints, high: Ints) -> None:
        self._corners, self._targets, self._low = corners, TARGETS[sep], low
        self._first = np.maximum(np.floor(corners.min(axis=1)).astype(np.int64), low)
        self._last = np.minimum(np.floor(corners.max(axis=1)).astype(np.int64), high - 1)

    def keys(self) -> Iterator[Ints]:
        """Packed coordinates of the voxels, sorted within each array."""
        here = np.flatnonzero((self._first <= self._last).all(axis=1))
        level = 0
        while len(here):  # each triangle begins where at most eight cells hold it
            first, last = self._first[here] >> level, self._last[here] >> level
            small = (last - first <= 1).all(axis=1)
            yield from self._halved(here[small], first[small], level)
            here, level = here[~small], level + 1

    def _halved(self, triangles: Ints, cells: Ints, level: int) -> Iterator[Ints]:
        """The voxels in the eight cells from `cells` on, of a triangle each."""
        for at in range(0, len(triangles), CHUNK // 8):
            some = np.repeat(triangles[at : at + CHUNK // 8], 8)
            eight = (cells[at : at + CHUNK // 8, None] + EIGHT).reshape(-1, 3)
            inside = (eight >= self._first[some] >> level) & (eight <= self._last[some] >> level)
            some, eight = some[inside.all(axis=1)], eight[inside.all(axis=1)]
            test = _Test(self._corners[some], eight, level)
            if level:
                near = test.not_surely_apart()
                yield from self._halved(some[near], 2 * eight[near], level - 1)
                continue
            x, y, z = (eight[test.met(self._targets)] - self._low).T
            yield distinct(x << 2 * KEY_BITS | y << KEY_BITS | z)


class _Test:
    """Triangles against cells, one each; the last axis of every array is the pair's."""

    def __init__(self, corners: Floats, cells: Ints, level: int) -> None:
        self._corners, self._cells, self._size = corners, cells, 2.0**level
        vertices = np.ascontiguousarray(corners.transpose(1, 2, 0))
        self._from_centre = vertices - (cells.T + 0.5) * self._size
        self._edges = np.roll(vertices, -1, axis=0) - vertices
        self._longest = np.abs(self._edges).max(axis=(0, 1))
        self._farthest = np.abs(self._from_centre).max(axis=(0, 1)) + self._size

    def met(self, targets: tuple[Generators, ...]) -> Bools:
        """(n,) whether any of the targets of a voxel is met."""
        met = np.zeros(len(self._cells), np.bool_)
        for target in targets:
            apart = met.copy()
            for edge, generator in _axes(target):
                far, unsure = self._compared(edge, generator, target)
                apart |= far
                rest = np.flatnonzero(unsure & ~apart)
                apart[rest] = _apart_exactly(
                    self._corners[rest], self._cells[rest], edge, generator, target
                )
            met |= ~apart
        return met

    def not_surely_apart(self) -> Bools:
        """(n,) whether the cell itself may be met."""
        near = np.ones(len(self._cells), np.bool_)
        for edge, generator in _axes(VOXEL):
            near &= ~self._compared(edge, generator, VOXEL)[0]
        return near

    def _compared(
        self, edge: int | None, generator: Vector, target: Generators
    ) -> tuple[Bools, Bools]:
        """(n,) whether surely apart along an axis, and whether float64 cannot tell."""
        axis = _axis(self._edges, edge, generator)
        low, high = _span(axis, self._from_centre if edge is not None else self._from_centre[:1])
        reach = _reach(axis, target) * (self._size / 2)
        error = ERROR * self._farthest * self._longest
        if edge is None:
            error *= self._longest
        gap = np.maximum(low, -high) - reach
        return gap > error, np.abs(gap) <= error


def _axes(target: Generators) -> Iterator[tuple[int | None, Vector]]:
    """The edge and the generator of each axis; None for the normal."""
    yield None, target[0]
    for generator in target:
        for edge in range(3):
            yield edge, generator


def _axis(edges: Numbers, edge: int | None, generator: Vector) -> Numbers:
    """(3, n) normal, or edge x generator, of (3, 3, n) edges."""
    a = edges[0 if edge is None else edge]
    b = edges[1] if edge is None else generator
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _span(axis: Numbers, vertices: Numbers) -> tuple[Numbers, Numbers]:
    """(n,) least and greatest of the products of (3, n) axes with (k, 3, n) vertices."""
    heights = (vertices * axis).sum(axis=1)
    return heights.min(axis=0), heights.max(axis=0)


def _reach(axis: Numbers, target: Generators) -> Numbers:
    """(n,) how far a target of half-length generators reaches along (3, n) axes."""
    reaches = [abs(axis[0] * x + axis[1] * y + axis[2] * z) for x, y, z in target]
    total: Numbers = np.array(reaches).sum(axis=0)
    return total


def _apart_exactly(
    corners: Floats, voxels: Ints, edge: int | None, generator: Vector, target: Generators
) -> Bools:
    """(n,) whether triangles and targets are apart along an axis, in integers.

    corners : (n, 3, 3); voxels : (n, 3)
    """
    bits = _fraction_bits(corners)  # of each row: scaled by 2^bits, all its numbers are integers
    vertices = np.ldexp(corners, bits[:, None, None])
    centres = np.ldexp(voxels + 0.5, bits[:, None])
    halves = np.ldexp(0.5, bits)
    largest = np.abs(vertices - centres[:, None]).max(axis=(1, 2))
    # below these limits no product of _span or _reach exceeds 2^62
    narrow = np.maximum(largest, halves) < (2.0**19 if edge is None else 2.0**28)
    apart = np.empty(len(corners), np.bool_)
    for rows, whole in ((narrow, _as_int64), (~narrow, np.frompyfunc(int, 1, 1))):
        if rows.any():
            from_centre = whole(vertices[rows]) - whole(centres[rows])[:, None]
            apart[rows] = _apart_whole(
                from_centre.transpose(1, 2, 0), whole(halves[rows]), edge, generator, target
            )
    return apart


def _as_int64(values: Floats) -> Ints:
    return values.astype(np.int64)


def _apart_whole(
    vertices: Numbers, half: Numbers, edge: int | None, generator: Vector, target: Generators
) -> Bools:
    """(n,) as above, of (3, 3, n) integers from the centre; half : (n,) half a voxel's edge."""
    axis = _axis(np.roll(vertices, -1, axis=0) - vertices, edge, generator)
    low, high = _span(axis, vertices)
    reach = _reach(axis, target) * half
    x, y, z = axis
    first = np.where(x != 0, x, np.where(y != 0, y, z))  # the infinitesimal's way along the axis
    apart: Bools = (low > reach) | (high < -reach)
    apart |= (low == reach) & (first > 0) | (high == -reach) & (first < 0)
    if edge is None and len(target) == 1:
        apart |= first == 0
    return apart


def _fraction_bits(corners: Floats) -> NDArray[np.int32]:
    """(n,) binary digits behind the point of (n, 3, 3) numbers, at least the one of a centre."""
    mantissa, exponent = np.frexp(corners)
    digits = np.ldexp(mantissa, 53).astype(np.int64)
    trailing = np.frexp((digits & -digits).astype(np.float64))[1] - 1
    behind = np.where(digits == 0, 0, 53 - exponent - trailing)
    bits: NDArray[np.int32] = np.maximum(behind.max(axis=(1, 2)), 1)
    return bits
