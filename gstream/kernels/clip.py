"""Areas of a triangle inside voxels: float64 clipping in the triangle's own frame.

Nothing here decides membership. Each result is a pure function of the triangle and the voxel, so it
does not depend on the cell that asks. The triangle is seen along its dominant axis w as a polygon
in (u, v); a voxel column cuts it to a polygon, and a plane w = l cuts that one in two.
Unit: voxels. Polygons hold at most 9 corners.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part

F64 = NDArray[np.float64]
CORNERS = 12


@part
def cut(poly: F64, count: int, axis: int, at: float, keep_above: bool, out: F64) -> int:
    """Cut a convex polygon by the line poly[axis] = at and keep one side.

    poly, out : (2, CORNERS) f8   corners in order; columns 0..count-1 are used
    returns : int   corners kept in `out`
    """
    kept = 0
    sign = 1.0 if keep_above else -1.0
    before = count - 1
    d_before = sign * (poly[axis, before] - at)
    for i in range(count):
        d = sign * (poly[axis, i] - at)
        if (d < 0.0) != (d_before < 0.0):
            t = d_before / (d_before - d)
            out[0, kept] = poly[0, before] + t * (poly[0, i] - poly[0, before])
            out[1, kept] = poly[1, before] + t * (poly[1, i] - poly[1, before])
            out[axis, kept] = at
            kept += 1
        if d >= 0.0:
            out[0, kept] = poly[0, i]
            out[1, kept] = poly[1, i]
            kept += 1
        before, d_before = i, d
    return kept


@part
def clip_between(
    poly: F64, count: int, axis: int, low: float, high: float, spare: F64, out: F64
) -> int:
    """Keep the part of a convex polygon with low <= poly[axis] <= high; returns its corner count."""
    smallest, largest = poly[axis, 0], poly[axis, 0]
    for i in range(1, count):
        smallest = min(smallest, poly[axis, i])
        largest = max(largest, poly[axis, i])
    if smallest >= low and largest <= high:
        for i in range(count):
            out[0, i] = poly[0, i]
            out[1, i] = poly[1, i]
        return count
    if smallest >= low:
        return cut(poly, count, axis, high, False, out)
    if largest <= high:
        return cut(poly, count, axis, low, True, out)
    between = cut(poly, count, axis, low, True, spare)
    if between == 0:
        return 0
    return cut(spare, between, axis, high, False, out)


@part
def moments_of(poly: F64, count: int, first_moments: bool, moments: F64) -> None:
    """Signed area of a polygon and, when wanted, its first moments.

    moments : (3,) f8   out: area, integral of u, integral of v
    The corners are taken relative to the first one, which keeps the sums accurate far from 0.
    """
    u0, v0 = poly[0, 0], poly[1, 0]
    area, mu, mv = 0.0, 0.0, 0.0
    a, b = poly[0, 1] - u0, poly[1, 1] - v0
    for i in range(2, count):
        c, d = poly[0, i] - u0, poly[1, i] - v0
        twice = a * d - b * c
        area += twice
        if first_moments:
            mu += twice * (a + c)
            mv += twice * (b + d)
        a, b = c, d
    moments[0] = 0.5 * area
    moments[1] = mu / 6.0 + moments[0] * u0
    moments[2] = mv / 6.0 + moments[0] * v0


@part
def below_height(
    poly: F64, count: int, at: float, spare: F64, first_moments: bool, moments: F64
) -> None:
    """Area and moments of the part of a polygon whose height, poly[2], is at most `at`."""
    kept = 0
    before = count - 1
    d_before = at - poly[2, before]
    for i in range(count):
        d = at - poly[2, i]
        if (d < 0.0) != (d_before < 0.0):
            t = d_before / (d_before - d)
            spare[0, kept] = poly[0, before] + t * (poly[0, i] - poly[0, before])
            spare[1, kept] = poly[1, before] + t * (poly[1, i] - poly[1, before])
            kept += 1
        if d >= 0.0:
            spare[0, kept] = poly[0, i]
            spare[1, kept] = poly[1, i]
            kept += 1
        before, d_before = i, d
    if kept < 3:
        moments[0] = 0.0
        moments[1] = 0.0
        moments[2] = 0.0
    else:
        moments_of(spare, kept, first_moments, moments)
