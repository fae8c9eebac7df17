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

ROW = 4  # voxels along u of a box of `cover`
NEVER = 2.0  # a step that is not made: beyond the end of the walk
LATE = 2.0**-40  # downward steps onto the lattice come after upward ones, and never at the end


@part
def walk_edge(
    place: F64, cell: I64, a: int, b: int, columns: int, cover: F64, ends: F64, squares: I64
) -> None:
    """Add the triangle's edge from corner a to corner b; note where it crosses levels.

    place : (3, 3) f8   corners along u, v, w
    cell : (3, 3) i8   their voxels, floor of `place`
    columns : rows of squares in a layer
    cover : (voxels, 2) f8   own area and area of all that follow in the row, added to
    ends : (2, levels, 2) f8   out: u, v of the upward (0) and downward (1) crossing of a level
    squares : (2, levels, 2) i8   out: i, j there; level 0 takes what is not needed
    """
    u, v = place[a, 0], place[a, 1]
    du, dv, dw = place[b, 0] - u, place[b, 1] - v, place[b, 2] - place[a, 2]
    i, j, l = cell[a, 0], cell[a, 1], cell[a, 2]
    per_u, per_v, per_w = 1.0 / du, 1.0 / dv, 1.0 / dw
    step_u, step_v, step_w = np.int64(1), np.int64(1), np.int64(1)
    next_u, next_v = (i + 1 - u) * per_u, (j + 1 - v) * per_v
    next_w = (l + 1 - place[a, 2]) * per_w
    if du < 0.0:
        step_u, next_u = np.int64(-1), (i - u) * per_u + LATE
    if dv < 0.0:
        step_v, next_v = np.int64(-1), (j - v) * per_v + LATE
    if dw < 0.0:
        step_w, next_w = np.int64(-1), (l - place[a, 2]) * per_w + LATE
    per_u, per_v, per_w = abs(per_u), abs(per_v), abs(per_w)
    down = np.int64(dw < 0.0)
    steps = abs(cell[b, 0] - i) + abs(cell[b, 1] - j) + abs(cell[b, 2] - l)
    at = 0.0
    for _ in range(steps):
        to = min(min(next_u, next_v), min(next_w, 1.0))
        rise = (to - at) * dv
        row = (l * columns + j) * ROW + i
        cover[row, 0] += rise * (i + 1 - (u + 0.5 * (at + to) * du))
        cover[row, 1] += rise
        first_u = (next_u <= next_v) & (next_u <= next_w)
        first_v = (next_v <= next_w) & (not first_u)
        first_w = not (first_u | first_v)
        i += step_u if first_u else 0
        j += step_v if first_v else 0
        level = max(l, l + step_w) if first_w else 0
        l += step_w if first_w else 0
        next_u += per_u if first_u else 0.0
        next_v += per_v if first_v else 0.0
        next_w += per_w if first_w else 0.0
        ends[down, level, 0] = u + to * du
        ends[down, level, 1] = v + to * dv
        squares[down, level, 0] = i
        squares[down, level, 1] = j
        at = to
    rise = (1.0 - at) * dv
    row = (l * columns + j) * ROW + i
    cover[row, 0] += rise * (i + 1 - (u + 0.5 * (at + 1.0) * du))
    cover[row, 1] += rise


@part
def walk_level(level: int, columns: int, cover: F64, ends: F64, squares: I64) -> None:
    """Add the segment between two layers, from where the outline goes up to where it comes down."""
    u, v = ends[0, level, 0], ends[0, level, 1]
    du, dv = ends[1, level, 0] - u, ends[1, level, 1] - v
    i, j = squares[0, level, 0], squares[0, level, 1]
    left_u, left_v = squares[1, level, 0] - i, squares[1, level, 1] - j
    per_u = 1.0 / du if du != 0.0 else 0.0
    per_v = 1.0 / dv if dv != 0.0 else 0.0
    step_u = np.int64(1) if left_u > 0 else np.int64(-1)
    step_v = np.int64(1) if left_v > 0 else np.int64(-1)
    next_u = (i + (1 if left_u > 0 else 0) - u) * per_u if left_u != 0 else NEVER
    next_v = (j + (1 if left_v > 0 else 0) - v) * per_v if left_v != 0 else NEVER
    per_u, per_v = abs(per_u), abs(per_v)
    left_u, left_v = abs(left_u), abs(left_v)
    at, layer = 0.0, columns * ROW
    for _ in range(left_u + left_v):
        # Crossings are rounded, so that they may lie beyond the segment's ends by a bit.
        to = max(min(min(next_u, next_v), 1.0), at)
        rise = (to - at) * dv
        own = rise * (i + 1 - (u + 0.5 * (at + to) * du))
        row = ((level - 1) * columns + j) * ROW + i
        cover[row, 0] += own
        cover[row, 1] += rise
        cover[row + layer, 0] -= own
        cover[row + layer, 1] -= rise
        if next_u <= next_v:
            i += step_u
            left_u -= 1
            next_u = next_u + per_u if left_u > 0 else NEVER
        else:
            j += step_v
            left_v -= 1
            next_v = next_v + per_v if left_v > 0 else NEVER
        at = to
    rise = (1.0 - at) * dv
    own = rise * (i + 1 - (u + 0.5 * (at + 1.0) * du))
    row = ((level - 1) * columns + j) * ROW + i
    cover[row, 0] += own
    cover[row, 1] += rise
    cover[row + layer, 0] -= own
    cover[row + layer, 1] -= rise
