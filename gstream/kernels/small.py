"""Triangles whose voxels fit in a box of 8^3: all the box's voxels at once, nearly no branches.

`fragments.py` asks voxel by voxel and leaves early; on triangles of 1 to 3 voxels most of that time
went to mispredicted branches. Here every test of every voxel is made: a word that is negative iff
the voxel is beyond the edge or plane, words are or-ed, and the sign decides whether the fragment
just written is kept. Areas come from `cover.py`. Whether a triangle comes here depends on the
triangle alone, so its fragments are still the same in any box.

Frame: the low corner of the lowest voxel the triangle may meet (below a lattice corner on closed
ties), corners sorted by coordinates, axes (u, v, w) with w the normal's largest component.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part
from gstream.kernels.clip import AREA_UNITS
from gstream.kernels.cover import walk_level, walk_outline
from gstream.kernels.overlap import (
    N_NEGATIVE,
    N_POSITIVE,
    N_X,
    N_Y,
    N_Z,
    dominant_axis,
    face_mask,
    first_sign,
    longest_edge,
    prepare_normal,
    tie,
    unit_normal,
)

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

EDGE = 8  # most voxels of the box along an axis
RUN = 4  # voxels of a row that are written without a branch between them
SNAP_BITS = 16  # up to here corners fit 20 bits and plane values 62
CELLS = EDGE**3


@part
def load_small(corners: I64, k: int, closed: bool, tri: I64, box: I64) -> int:
    """Move a triangle to its own frame, corners in ascending order of (x, y, z).

    corners : (3, 3) i8   snap units, relative to the box being filled
    tri : (3, 3) i8   out: sorted corners in the frame
    box : (3, 3) i8   out: rows lowest voxel; zero; last voxel met, relative to the lowest
    returns : int   -1 where sorting mirrored the triangle, else 1; 0 if it is not small
    """
    small = k <= SNAP_BITS
    for c in range(3):
        x, y, z = corners[0, c], corners[1, c], corners[2, c]
        low, high = min(x, y, z), max(x, y, z)
        base = -((-low) >> k) - 1 if closed else low >> k
        box[0, c] = base
        box[1, c] = 0
        box[2, c] = (high >> k) - base
        small &= box[2, c] < EDGE
    if not small:
        return 0
    x, y, z = box[0, 0] << k, box[0, 1] << k, box[0, 2] << k
    # One integer per corner, 20 bits per coordinate: sorted without a branch.
    a = ((corners[0, 0] - x) << 40) + ((corners[0, 1] - y) << 20) + (corners[0, 2] - z)
    b = ((corners[1, 0] - x) << 40) + ((corners[1, 1] - y) << 20) + (corners[1, 2] - z)
    d = ((corners[2, 0] - x) << 40) + ((corners[2, 1] - y) << 20) + (corners[2, 2] - z)
    first, third = min(a, b, d), max(a, b, d)
    unpack(first, tri, 0)
    unpack(a + b + d - first - third, tri, 1)
    unpack(third, tri, 2)
    return 1 - 2 * ((np.int64(a > b) + np.int64(b > d) + np.int64(a > d)) & 1)


@part
def emit_small(
    t: int, turn: int, k: int, closed: bool, both: bool, room: tuple[int, int, int],
    tri: I64, box: I64, plane: I64, scratch: tuple[I64, F64, I64, F64, NDArray[np.uint32]],
    spread: NDArray[np.uint32], normals: F64, masks: NDArray[np.uint8],
    keys: NDArray[np.uint32], owners: NDArray[np.int32], areas: F64, count: int,
) -> int:  # fmt: skip
    """Fragments of triangle t, as `load_small` left it, from place `count` of the buffer on.

    scratch : words of `test_projection`, corners and their voxels, cover, codes along u
    owners : (b,) i4   out: the voxel's place in the triangle's box, u + 8 v + 64 w
    returns : int   fragments in the buffer; see `fragments.emit` for the rest
    """
    outside, place, cell, cover, codes = scratch
    x0, x1 = max(0, -box[0, 0]), min(box[2, 0], room[0] - 1 - box[0, 0])
    y0, y1 = max(0, -box[0, 1]), min(box[2, 1], room[1] - 1 - box[0, 1])
    z0, z1 = max(0, -box[0, 2]), min(box[2, 2], room[2] - 1 - box[0, 2])
    if x0 > x1 or y0 > y1 or z0 > z1:
        return count
    prepare_normal(tri, plane)
    masks[t] = face_mask(plane, turn, both)
    length = unit_normal(plane, turn, normals[t])
    if box[2, 0] | box[2, 1] | box[2, 2] == 0:  # one voxel: it holds all of the triangle
        keys[count] = (
            spread[box[0, 0]]
            | (spread[box[0, 1]] << np.uint32(1))
            | (spread[box[0, 2]] << np.uint32(2))
        )
        owners[count] = 0
        areas[count] = 0.5 * AREA_UNITS * length / np.float64(np.int64(1) << (2 * k))
        return count + 1
    w = dominant_axis(plane, box)
    u, v = (w + 1) % 3, (w + 2) % 3
    factor = 0.0
    if plane[w] != 0:
        factor = AREA_UNITS * length / abs(np.float64(plane[w]))
    rows_x, rows_y, rows_z = box[2, 0] + 1, box[2, 1] + 1, box[2, 2] + 1
    test_projection(tri, plane, k, closed, 0, 1, 2, y0, y1, rows_y, rows_z, outside)
    test_projection(tri, plane, k, closed, 1, 2, 0, z0, z1, rows_z, rows_x, outside)
    test_projection(tri, plane, k, closed, 2, 0, 1, x0, x1, rows_x, rows_y, outside)
    above, below = plane_limits(tri, plane, k, closed)
    cover_small(tri, k, box, u, v, w, place, cell, cover)
    return np.int64(
        write_small(
            plane, box, u, v, w, above, below, factor, outside, cover, codes, spread,
            np.uint64(count), keys, owners, areas,
        )
    )  # fmt: skip


@part
def unpack(packed: int, tri: I64, corner: int) -> None:
    """Coordinates of 20 bits each, x highest."""
    tri[corner, 0] = packed >> 40
    tri[corner, 1] = (packed >> 20) & 0xFFFFF
    tri[corner, 2] = packed & 0xFFFFF


@part
def plane_limits(tri: I64, plane: I64, k: int, closed: bool) -> tuple[int, int]:
    """(above, below): the plane meets voxel x iff n.x + above >= 0 and n.x + below <= 0.

    As `overlap.prepare_plane`, where nothing can overflow.
    """
    sign = first_sign(plane[N_X], plane[N_Y], plane[N_Z])
    up, down = tie(sign, closed), tie(-sign, closed)
    value = plane[N_X] * tri[0, 0] + plane[N_Y] * tri[0, 1] + plane[N_Z] * tri[0, 2]
    return plane[N_POSITIVE] + ((-value - up) >> k), plane[N_NEGATIVE] - ((value - down) >> k)


@part
def half_plane(
    tri: I64, start: int, end: int, turn: int, k: int, closed: bool, r: int, p: int, q: int
) -> tuple[int, int, int]:
    """(A, B, C): the square (i, j) of the projection along r is not beyond the edge from corner
    `start` to `end`, on side `turn`, iff A*i + B*j + C >= 0. As `overlap.edge_rule`."""
    a = turn * (tri[start, q] - tri[end, q])
    b = turn * (tri[end, p] - tri[start, p])
    first, second = (b, a) if r == 1 else (a, b)
    shifted = np.int64(((first > 0) | ((first == 0) & (second > 0))) & (not closed))
    c = -a * tri[start, p] - b * tri[start, q] - shifted
    return a, b, (c + ((max(a, 0) + max(b, 0)) << k)) >> k


@part
def test_projection(
    tri: I64, plane: I64, k: int, closed: bool, r: int, p: int, q: int, low: int, high: int,
    width: int, rows: int, outside: I64,
) -> None:  # fmt: skip
    """Words of the box's squares seen along axis r: negative beyond an edge or outside the window.

    low, high : first and last voxel of the window along p
    width, rows : voxels of the box along p and q
    outside : (192,) i8   out: at 64 * r + 8 * (voxel along q) + (voxel along p)
    """
    if plane[r] == 0:  # a segment: two opposite half planes
        edge = longest_edge(tri, p, q)
        end = edge + 1 if edge < 2 else 0
        a0, b0, c0 = half_plane(tri, edge, end, 1, k, closed, r, p, q)
        a1, b1, c1 = half_plane(tri, edge, end, -1, k, closed, r, p, q)
        a2, b2, c2 = np.int64(0), np.int64(0), np.int64(0)
    else:
        turn = 1 if plane[r] > 0 else -1
        a0, b0, c0 = half_plane(tri, 0, 1, turn, k, closed, r, p, q)
        a1, b1, c1 = half_plane(tri, 1, 2, turn, k, closed, r, p, q)
        a2, b2, c2 = half_plane(tri, 2, 0, turn, k, closed, r, p, q)
    start = r * EDGE * EDGE
    for j in range(rows):
        for first in range(0, width, RUN):
            for i in range(first, first + RUN):
                edges = (a0 * i + c0) | (a1 * i + c1) | (a2 * i + c2)
                outside[np.uint64(start + EDGE * j + i)] = edges | (i - low) | (high - i)
        c0 += b0
        c1 += b1
        c2 += b2


@part
def cover_small(
    tri: I64, k: int, box: I64, u: int, v: int, w: int,
    place: F64, cell: I64, cover: F64,
) -> None:  # fmt: skip
    """Areas of a triangle in the voxels of its box, seen along w, into `cover`."""
    scale = 1.0 / (1 << k)
    for a in range(3):
        place[a, 0], cell[a, 0] = tri[a, u] * scale, tri[a, u] >> k
        place[a, 1], cell[a, 1] = tri[a, v] * scale, tri[a, v] >> k
        place[a, 2], cell[a, 2] = tri[a, w] * scale, tri[a, w] >> k
    width = (box[2, u] // RUN + 1) * RUN
    layer = width * (box[2, v] + 1)
    cover[: 2 * layer * (box[2, w] + 1)] = 0.0
    walk_outline(place, cell, width, layer, cover)
    lowest = min(cell[0, 2], cell[1, 2], cell[2, 2])
    for level in range(lowest + 1, box[2, w] + 1):
        walk_level(place, cell, level, width, layer, cover)
    if lowest == 1 and tri[0, w] == tri[1, w] == tri[2, w]:
        # Closed ties, in a plane of the lattice: the layer below has the same area.
        place[:, 2], cell[:, 2] = 0.0, 0
        walk_outline(place, cell, width, layer, cover)


@part
def write_small(
    plane: I64, box: I64, u: int, v: int, w: int, above: int, below: int, factor: float,
    outside: I64, cover: F64, codes: NDArray[np.uint32], spread: NDArray[np.uint32], count: int,
    keys: NDArray[np.uint32], owners: NDArray[np.int32], areas: F64,
) -> int:  # fmt: skip
    """Write a fragment for each voxel of the box, and keep those that pass.

    factor : area units per area seen along w
    owners : (b,) i4   out: the voxel's place in the triangle's box, u + 8 v + 64 w
    returns : int   fragments in the buffer
    """
    width = (box[2, u] // RUN + 1) * RUN
    for i in range(width):  # & 255: voxels outside the window are read, but never kept
        codes[i] = spread[(box[0, u] + i) & 255] << np.uint32(u)
    n_u, n_v, n_w = plane[u], plane[v], plane[w]
    most, least = (width - 1) * max(n_u, 0), (width - 1) * min(n_u, 0)
    columns, here = box[2, v] + 1, np.uint64(0)
    for l in range(box[2, w] + 1):
        for j in range(columns):
            side = outside[np.uint64(EDGE * (EDGE * u + l) + j)]
            value = n_w * l + n_v * j
            over, under = value + above, -(value + below)
            if (side | (over + most) | (under - least)) < 0:
                here += np.uint64(2 * width)
                continue
            key = (spread[(box[0, v] + j) & 255] << np.uint32(v)) | (
                spread[(box[0, w] + l) & 255] << np.uint32(w)
            )
            row, column = np.uint64(EDGE * (EDGE * w + j)), np.uint64(EDGE * EDGE * v + l)
            passed = 0.0
            for first in range(0, width, RUN):
                for i in range(first, first + RUN):
                    word = (
                        side | outside[row + np.uint64(i)] | outside[column + np.uint64(EDGE * i)]
                    )
                    word |= (over + n_u * i) | (under - n_u * i)
                    keys[count] = key | codes[np.uint64(i)]
                    owners[count] = i | (j << 3) | (l << 6)
                    areas[count] = abs(passed + cover[here]) * factor
                    passed += cover[here + np.uint64(1)]
                    here += np.uint64(2)
                    count += np.uint64(1) - (np.uint64(word) >> np.uint64(63))
    return count
