"""Exact tests of the targets of `--sep 6` and `--sep 26` inside a voxel that the triangle meets.

6: three axis-parallel segments through the voxel's centre, face centre to face centre.
26: the four space diagonals. A target is met iff its ends lie on both sides of the plane and its
line passes the triangle. With one-sided ties a target parallel to the plane is never met, since
the shift moves the plane off it; with closed ties it can be, and the slow forms below decide.

Source: Laine 2013; numerics.md section 1.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part
from gstream.kernels.overlap import (
    CEIL,
    CENTRE_CEIL,
    CENTRE_FLOOR,
    FLOOR,
    first_sign,
    tie,
)

I64 = NDArray[np.int64]


@part
def diagonal_step(m: int, c: int) -> int:
    """Component c of space diagonal m: (1,1,1), (-1,1,1), (1,-1,1), (1,1,-1)."""
    return -1 if c == m - 1 else 1


@part
def diagonal_end(voxel: I64, k: int, m: int, c: int, end: int) -> int:
    """Coordinate c of an end (0 or 1) of space diagonal m of a voxel."""
    up = end if diagonal_step(m, c) > 0 else 1 - end
    return (voxel[c] + up) << k


@part
def prepare_diagonals(tri: I64, plane: I64, k: int, closed: bool, lines: I64, ends: I64) -> None:
    """Thresholds for the four space diagonals.

    lines : (4, 3, 4) i8   out [diagonal, edge, (a, b, c, threshold)]: the diagonal's line passes
        the edge on the triangle's side iff a*i + b*j + c*l + threshold >= 0
    ends : (4, 3) i8   out [diagonal, (sign of n.s, low, high)]: plane values of the two ends
        relative to the voxel's low corner
    """
    half = np.int64(1) << (k - 1)
    for m in range(4):
        along, total = np.int64(0), np.int64(0)
        for c in range(3):
            along += plane[c] * diagonal_step(m, c)
            total += plane[c]
        turn = first_sign(along, 0, 0)
        ends[m, 0] = turn
        ends[m, 1] = (total - abs(along)) >> 1
        ends[m, 2] = (total + abs(along)) >> 1
        for e in range(3):
            value = np.int64(0)
            for c in range(3):
                p, q = (c + 1) % 3, (c + 2) % 3
                edge_p = tri[(e + 1) % 3, p] - tri[e, p]
                edge_q = tri[(e + 1) % 3, q] - tri[e, q]
                a = turn * (diagonal_step(m, p) * edge_q - diagonal_step(m, q) * edge_p)
                lines[m, e, c] = a
                value += a * (half - tri[e, c])
            sign = first_sign(lines[m, e, 0], lines[m, e, 1], lines[m, e, 2])
            lines[m, e, 3] = (value - tie(sign, closed)) >> k


@part
def meets_centre_lines(
    tri: I64, plane: I64, edges: I64, centres: I64, k: int, closed: bool, voxel: I64, value: int
) -> bool:
    """The triangle meets a centre segment of the voxel (which it is known to meet).

    voxel : (3,) i8   in the triangle's frame; value: n.voxel relative to the window
    """
    # Spelt out, so that the axes are constants, as in `overlap.prepare_edges`.
    return (
        meets_centre_line(tri, plane, edges, centres, k, closed, voxel, value, 0, 1, 2)
        or meets_centre_line(tri, plane, edges, centres, k, closed, voxel, value, 1, 2, 0)
        or meets_centre_line(tri, plane, edges, centres, k, closed, voxel, value, 2, 0, 1)
    )


@part
def meets_centre_line(
    tri: I64, plane: I64, edges: I64, centres: I64, k: int, closed: bool, voxel: I64, value: int,
    r: int, p: int, q: int,
) -> bool:  # fmt: skip
    """`meets_centre_lines` for the segment along axis r; p and q are the two that follow."""
    n, i, j = plane[r], voxel[p], voxel[q]
    if n == 0 and not closed:
        return False
    if value - plane[CENTRE_CEIL + r] + max(n, 0) < 0:
        return False
    if value - plane[CENTRE_FLOOR + r] + min(n, 0) > 0:
        return False
    if (
        edges[r, 0, 0] * i + edges[r, 0, 1] * j + centres[r, 0] < 0
        or edges[r, 1, 0] * i + edges[r, 1, 1] * j + centres[r, 1] < 0
        or edges[r, 2, 0] * i + edges[r, 2, 1] * j + centres[r, 2] < 0
    ):
        return False
    return n != 0 or closed_segment_meets(tri, k, r, voxel)


@part
def meets_diagonals(
    tri: I64, plane: I64, lines: I64, ends: I64, k: int, closed: bool, voxel: I64, value: int
) -> bool:
    """The triangle meets a space diagonal of the voxel (which it is known to meet).

    voxel : (3,) i8   in the triangle's frame; value: n.voxel relative to the window
    """
    i, j, l = voxel[0], voxel[1], voxel[2]
    for m in range(4):
        if ends[m, 0] == 0:
            if closed and closed_diagonal_meets(tri, plane, k, m, voxel, value):
                return True
            continue
        if value - plane[CEIL] + ends[m, 2] < 0 or value - plane[FLOOR] + ends[m, 1] > 0:
            continue
        passes = True
        for e in range(3):
            if lines[m, e, 0] * i + lines[m, e, 1] * j + lines[m, e, 2] * l + lines[m, e, 3] < 0:
                passes = False
                break
        if passes:
            return True
    return False


@part
def segment_end(voxel: I64, k: int, r: int, c: int, end: int) -> int:
    """Coordinate c of the low (0) or high (1) end of the voxel's centre segment along axis r."""
    half = np.int64(1) << (k - 1)
    return (voxel[c] << k) + (2 * half * end if c == r else half)


@part
def closed_segment_meets(tri: I64, k: int, r: int, voxel: I64) -> bool:
    """Closed ties, triangle parallel to axis r and its plane through the segment: do they meet?

    The separating axes of a box that has shrunk to the segment: its three axes, and the nine
    crosses with the edges; the caller has tested the plane.
    """
    for c in range(3):
        if max(tri[0, c], tri[1, c], tri[2, c]) < segment_end(voxel, k, r, c, 0):
            return False
        if min(tri[0, c], tri[1, c], tri[2, c]) > segment_end(voxel, k, r, c, 1):
            return False
    for e in range(3):
        for axis in range(3):
            p, q = (axis + 1) % 3, (axis + 2) % 3
            a = tri[(e + 1) % 3, q] - tri[e, q]
            b = tri[e, p] - tri[(e + 1) % 3, p]
            first = a * tri[0, p] + b * tri[0, q]
            second = a * tri[1, p] + b * tri[1, q]
            third = a * tri[2, p] + b * tri[2, q]
            box_low = a * segment_end(voxel, k, r, p, 0 if a > 0 else 1)
            box_low += b * segment_end(voxel, k, r, q, 0 if b > 0 else 1)
            box_high = a * segment_end(voxel, k, r, p, 1 if a > 0 else 0)
            box_high += b * segment_end(voxel, k, r, q, 1 if b > 0 else 0)
            if max(first, second, third) < box_low or min(first, second, third) > box_high:
                return False
    return True


@part
def closed_diagonal_meets(tri: I64, plane: I64, k: int, m: int, voxel: I64, value: int) -> bool:
    """Closed ties, diagonal m parallel to the plane or the triangle degenerate: do they meet?

    Both lie in one plane or not at all; then they are compared in a projection that is faithful for
    that plane, by the separating axes of a 2D triangle and a 2D segment.
    """
    for c in range(3):
        if max(tri[0, c], tri[1, c], tri[2, c]) < voxel[c] << k:
            return False
        if min(tri[0, c], tri[1, c], tri[2, c]) > (voxel[c] + 1) << k:
            return False
    middle = (plane[0] + plane[1] + plane[2]) >> 1  # n.s = 0, so the sum is even
    if value - plane[CEIL] + middle < 0 or value - plane[FLOOR] + middle > 0:
        return False
    if plane[0] == 0 and plane[1] == 0 and plane[2] == 0 and not _coplanar(tri, voxel, k, m):
        return False
    # All three projections: at least one is faithful, and the others are necessary conditions.
    return not (
        _separated_in_projection(tri, voxel, k, m, 0)
        or _separated_in_projection(tri, voxel, k, m, 1)
        or _separated_in_projection(tri, voxel, k, m, 2)
    )


@part
def _coplanar(tri: I64, voxel: I64, k: int, m: int) -> bool:
    """The line of a degenerate triangle and the diagonal lie in one plane."""
    longest, start = np.int64(-1), 0
    for e in range(3):
        d = np.int64(0)
        for c in range(3):
            d += abs(tri[(e + 1) % 3, c] - tri[e, c])
        if d > longest:
            longest, start = d, e
    volume = np.int64(0)
    for c in range(3):
        p, q = (c + 1) % 3, (c + 2) % 3
        edge_p = tri[(start + 1) % 3, p] - tri[start, p]
        edge_q = tri[(start + 1) % 3, q] - tri[start, q]
        across = edge_p * diagonal_step(m, q) - edge_q * diagonal_step(m, p)
        volume += across * (diagonal_end(voxel, k, m, c, 0) - tri[start, c])
    return volume == 0


@part
def _separated_in_projection(tri: I64, voxel: I64, k: int, m: int, axis: int) -> bool:
    """A line of the plane separates the projected triangle and segment."""
    p, q = (axis + 1) % 3, (axis + 2) % 3
    for e in range(4):
        if e < 3:
            a = tri[(e + 1) % 3, q] - tri[e, q]
            b = tri[e, p] - tri[(e + 1) % 3, p]
        else:
            a = np.int64(diagonal_step(m, q))
            b = np.int64(-diagonal_step(m, p))
        first = a * tri[0, p] + b * tri[0, q]
        second = a * tri[1, p] + b * tri[1, q]
        third = a * tri[2, p] + b * tri[2, q]
        one = a * diagonal_end(voxel, k, m, p, 0) + b * diagonal_end(voxel, k, m, q, 0)
        other = a * diagonal_end(voxel, k, m, p, 1) + b * diagonal_end(voxel, k, m, q, 1)
        if max(first, second, third) < min(one, other):
            return True
        if min(first, second, third) > max(one, other):
            return True
    return False
