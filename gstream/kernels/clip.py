"""Areas of a triangle inside voxels: float64 clipping in the triangle's own frame.

Nothing here decides membership. Each result is a pure function of the triangle and the voxel, so it
does not depend on the cell that asks. The triangle is seen along its dominant axis w as a polygon
in (u, v); a voxel column cuts it to a polygon, and a plane w = l cuts that one in two.
Unit: voxels. A polygon is two arrays of coordinates, its corners in order.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part

F64 = NDArray[np.float64]
AREA_UNITS = 2.0**26  # accumulator units per voxel face
# Units of the area vector in one unit of area. With 1, a voxel met by slivers alone had a vector of
# a few units, and its rounding turned the normal by up to 38 degrees; now by 0.012 at most.
VECTOR_UNITS = 2.0**12
CORNERS = 12  # a triangle cut by five planes has at most 8


@part
def cut(x: F64, y: F64, count: int, at: float, sign: float, out_x: F64, out_y: F64) -> int:
    """Cut a convex polygon by the line x = at; keep x >= at (sign 1) or x <= at (sign -1).

    returns : int   corners kept in out_x, out_y
    """
    kept = 0
    x_before, y_before = x[count - 1], y[count - 1]
    d_before = sign * (x_before - at)
    for i in range(count):
        x_now, y_now = x[i], y[i]
        d = sign * (x_now - at)
        if (d < 0.0) != (d_before < 0.0):
            out_x[kept] = at
            out_y[kept] = y_before + d_before / (d_before - d) * (y_now - y_before)
            kept += 1
        if d >= 0.0:
            out_x[kept] = x_now
            out_y[kept] = y_now
            kept += 1
        x_before, y_before, d_before = x_now, y_now, d
    return kept


@part
def clip_between(
    x: F64, y: F64, count: int, low: float, spare_x: F64, spare_y: F64, out_x: F64, out_y: F64
) -> int:
    """Keep the part of a convex polygon with low <= x <= low + 1; returns its corner count."""
    smallest, largest = x[0], x[0]
    for i in range(1, count):
        smallest = min(smallest, x[i])
        largest = max(largest, x[i])
    high = low + 1.0
    if smallest >= low:
        if largest <= high:
            for i in range(count):
                out_x[i] = x[i]
                out_y[i] = y[i]
            return count
        return cut(x, y, count, high, -1.0, out_x, out_y)
    if largest <= high:
        return cut(x, y, count, low, 1.0, out_x, out_y)
    between = cut(x, y, count, low, 1.0, spare_x, spare_y)
    if between == 0:
        return 0
    return cut(spare_x, spare_y, between, high, -1.0, out_x, out_y)


@part
def area_of(x: F64, y: F64, count: int) -> float:
    """Signed area of a polygon; corners relative to the first, so that far from 0 loses nothing."""
    x0, y0 = x[0], y[0]
    a, b = x[1] - x0, y[1] - y0
    twice = 0.0
    for i in range(2, count):
        c, d = x[i] - x0, y[i] - y0
        twice += a * d - b * c
        a, b = c, d
    return 0.5 * twice


@part
def square_below(height: float, steep: float, gentle: float) -> float:
    """Area of the part of a unit square over which a plane is below a height.

    height : above the plane's lowest corner; steep >= gentle >= 0 : its slopes, steep > 0
    source : the plane's height over a random point is a sum of two uniform variables
    """
    rising = min(max(height, 0.0), gentle)
    even = min(max(height - gentle, 0.0), steep - gentle)
    falling = min(max(height - steep, 0.0), gentle)
    share = 0.5 / gentle if gentle > 0.0 else 0.0
    return (rising * rising * share + even + falling - falling * falling * share) / steep


@part
def moments_of(x: F64, y: F64, count: int) -> tuple[float, float]:
    """First moments of a polygon: the integrals of x and y over it, with the sign of its area."""
    x0, y0 = x[0], y[0]
    a, b = x[1] - x0, y[1] - y0
    mx, my, twice = 0.0, 0.0, 0.0
    for i in range(2, count):
        c, d = x[i] - x0, y[i] - y0
        cross = a * d - b * c
        twice += cross
        mx += cross * (a + c)
        my += cross * (b + d)
        a, b = c, d
    return mx / 6.0 + 0.5 * twice * x0, my / 6.0 + 0.5 * twice * y0


@part
def cut_below(x: F64, y: F64, heights: F64, count: int, at: float, out_x: F64, out_y: F64) -> int:
    """Keep the part of a polygon whose height is at most `at`; returns its corner count, or 0.

    heights : height of the surface over each corner
    """
    kept = 0
    x_before, y_before = x[count - 1], y[count - 1]
    d_before = at - heights[count - 1]
    for i in range(count):
        x_now, y_now = x[i], y[i]
        d = at - heights[i]
        if (d < 0.0) != (d_before < 0.0):
            t = d_before / (d_before - d)
            out_x[kept] = x_before + t * (x_now - x_before)
            out_y[kept] = y_before + t * (y_now - y_before)
            kept += 1
        if d >= 0.0:
            out_x[kept] = x_now
            out_y[kept] = y_now
            kept += 1
        x_before, y_before, d_before = x_now, y_now, d
    return kept if kept > 2 else 0
