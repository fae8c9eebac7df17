"""Areas of a small triangle in all voxels of its box at once, by walking along outlines.

A triangle seen along its dominant axis w is cut by the planes w = 1, 2, ... into layers. The area
of a layer inside a square (i, j) is a sum over the pieces of the layer's outline: a piece that
rises by dv at mean place u adds dv * (i + 1 - u) to its own square and dv to all squares with
larger i (Green's theorem; the way font rasterisers fill). Outlines are the triangle's edges, walked
once, and the level segments between layers, which count for the layer below and, backwards, for the
one above. So a voxel costs the few pieces in it, not two clipped polygons.

Errors are about 1e-15 of a voxel face, and 2^-40 where a corner lies on the lattice.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

LATE = 2.0**-40  # crossings come late, so that no walk to the lattice enters the voxel beyond


@part
def walk_outline(place: F64, cell: I64, width: int, layer: int, cover: F64) -> None:
    """Add the triangle's three edges, side by side: alone, each would wait for its own results.

    place : (3, 3) f8   corners along u, v, w
    cell : (3, 3) i8   their voxels, floor of `place`
    width, layer : voxels in a row, and in a layer, of `cover`
    cover : (2 * voxels,) f8   own area and area of all that follow in the row, added to
    """
    u0, v0, w0 = place[0, 0], place[0, 1], place[0, 2]
    u1, v1, w1 = place[1, 0], place[1, 1], place[1, 2]
    u2, v2, w2 = place[2, 0], place[2, 1], place[2, 2]
    i0, j0, l0 = cell[0, 0], cell[0, 1], cell[0, 2]
    i1, j1, l1 = cell[1, 0], cell[1, 1], cell[1, 2]
    i2, j2, l2 = cell[2, 0], cell[2, 1], cell[2, 2]
    nu0, eu0, su0 = crossings(u0, u1 - u0, i0, 1)
    nv0, ev0, sv0 = crossings(v0, v1 - v0, j0, width)
    nw0, ew0, sw0 = crossings(w0, w1 - w0, l0, layer)
    nu1, eu1, su1 = crossings(u1, u2 - u1, i1, 1)
    nv1, ev1, sv1 = crossings(v1, v2 - v1, j1, width)
    nw1, ew1, sw1 = crossings(w1, w2 - w1, l1, layer)
    nu2, eu2, su2 = crossings(u2, u0 - u2, i2, 1)
    nv2, ev2, sv2 = crossings(v2, v0 - v2, j2, width)
    nw2, ew2, sw2 = crossings(w2, w0 - w2, l2, layer)
    row0, row1, row2 = (
        l0 * layer + j0 * width + i0,
        l1 * layer + j1 * width + i1,
        l2 * layer + j2 * width + i2,
    )
    right0, right1, right2 = i0 + 1 - u0, i1 + 1 - u1, i2 + 1 - u2
    at0, at1, at2 = 0.0, 0.0, 0.0
    while min(at0, at1, at2) < 1.0:
        row0, right0, at0, nu0, nv0, nw0 = advance(
            row0, right0, at0, nu0, nv0, nw0, u1 - u0, v1 - v0, eu0, ev0, ew0, su0, sv0, sw0, cover
        )
        row1, right1, at1, nu1, nv1, nw1 = advance(
            row1, right1, at1, nu1, nv1, nw1, u2 - u1, v2 - v1, eu1, ev1, ew1, su1, sv1, sw1, cover
        )
        row2, right2, at2, nu2, nv2, nw2 = advance(
            row2, right2, at2, nu2, nv2, nw2, u0 - u2, v0 - v2, eu2, ev2, ew2, su2, sv2, sw2, cover
        )


@part
def crossings(start: float, extent: float, cell: int, stride: int) -> tuple[float, float, int]:
    """Of a walk along one axis: part of it before the first lattice line and between two, step."""
    up = 1.0 if extent >= 0.0 else 0.0
    each = 1.0 / extent
    return (cell - start + up) * each + LATE, abs(each), stride if extent >= 0.0 else -stride


@part
def advance(
    row: int, right: float, at: float, next_u: float, next_v: float, next_w: float,
    du: float, dv: float, each_u: float, each_v: float, each_w: float,
    step_u: int, step_v: int, step_w: int, cover: F64,
) -> tuple[int, float, float, float, float, float]:  # fmt: skip
    """Add the piece of an edge up to the next lattice plane, and step over it.

    Selects, not branches: which axis comes next cannot be predicted. At the end nothing changes.
    """
    to = min(min(next_u, next_v), min(next_w, 1.0))
    rise = (to - at) * dv
    here = np.uint64(row + row)
    cover[here] += rise * (right - 0.5 * (at + to) * du)
    cover[here + np.uint64(1)] += rise
    row += step_u if next_u <= to else 0
    row += step_v if next_v <= to else 0
    row += step_w if next_w <= to else 0
    right += np.float64(step_u) if next_u <= to else 0.0
    next_u += each_u if next_u <= to else 0.0
    next_v += each_v if next_v <= to else 0.0
    next_w += each_w if next_w <= to else 0.0
    return row, right, to, next_u, next_v, next_w


@part
def walk_level(place: F64, cell: I64, level: int, width: int, layer: int, cover: F64) -> None:
    """Add the segment between layers level - 1 and level."""
    high_0, high_1, high_2 = cell[0, 2] >= level, cell[1, 2] >= level, cell[2, 2] >= level
    # The corner alone on its side, the one before and the one after.
    odd = 0 if high_1 == high_2 else (1 if high_0 == high_2 else 2)
    before, after = (odd + 2) % 3, (odd + 1) % 3
    u, v = crossing_point(place, before, odd, level)
    end_u, end_v = crossing_point(place, odd, after, level)
    du, dv = end_u - u, end_v - v
    signed = dv if cell[odd, 2] >= level else -dv
    i, j = np.int64(u), np.int64(v)
    next_u, each_u, step_u = crossings(u, du, i, 1)
    next_v, each_v, step_v = crossings(v, dv, j, width)
    above = np.uint64(2 * layer)
    row, right, at = (level - 1) * layer + j * width + i, i + 1 - u, 0.0
    while at < 1.0:
        to = min(min(next_u, next_v), 1.0)
        rise = (to - at) * signed
        own = rise * (right - 0.5 * (at + to) * du)
        here = np.uint64(row + row)
        cover[here] += own
        cover[here + np.uint64(1)] += rise
        cover[here + above] -= own
        cover[here + above + np.uint64(1)] -= rise
        row += step_u if next_u <= to else 0
        row += step_v if next_v <= to else 0
        right += np.float64(step_u) if next_u <= to else 0.0
        next_u += each_u if next_u <= to else 0.0
        next_v += each_v if next_v <= to else 0.0
        at = to


@part
def crossing_point(place: F64, a: int, b: int, level: int) -> tuple[float, float]:
    """(u, v) where the edge from corner a to corner b crosses a level."""
    t = (level - place[a, 2]) / (place[b, 2] - place[a, 2])
    u = place[a, 0] + t * (place[b, 0] - place[a, 0])
    return u, place[a, 1] + t * (place[b, 1] - place[a, 1])
