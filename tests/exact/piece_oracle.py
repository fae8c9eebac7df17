"""The pieces of a triangle by the rule of spec/blockfile.md, section 7.4, in Python's rationals.

Imports nothing of gstream. A ring is refined by all its cut points first and dealt out to slabs
then, where the kernel walks around it once for each slab.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from math import floor

Point = tuple[int, int, int]
Ring = list[Point]


def pieces(triangle: Sequence[Point], size: int) -> Counter[tuple[Point, Point, Point]]:
    """Triangles in blocks of `size` snap units, with global coordinates, least corner first."""
    least = min(range(3), key=lambda i: triangle[i])
    ring = [triangle[(least + i) % 3] for i in range(3)]
    found: Counter[tuple[Point, Point, Point]] = Counter()
    for in_x in slabs(ring, 0, size):
        for in_y in slabs(in_x, 1, size):
            for piece in slabs(in_y, 2, size):
                for b, c in pairwise(piece[1:]):
                    if len({piece[0], b, c}) == 3:
                        found[turned(piece[0], b, c)] += 1
    return found


def turned(*corners: Point) -> tuple[Point, Point, Point]:
    """The same triangle, its least corner first."""
    first = corners.index(min(corners))
    a, b, c = corners[first:] + corners[:first]
    return a, b, c


def slabs(ring: Ring, axis: int, size: int) -> Iterator[Ring]:
    """The parts of a ring between planes at multiples of `size`."""
    low, high = min(p[axis] for p in ring), max(p[axis] for p in ring)
    first = low // size + 1
    planes = [at * size for at in range(first, -(-high // size))]
    refined: list[tuple[Point, set[int]]] = []  # points, and the slabs that they bound
    for p, q in zip(ring, ring[1:] + ring[:1], strict=True):
        refined.append((p, {sum(plane <= p[axis] for plane in planes)}))
        crossed = [i for i, plane in enumerate(planes) if (p[axis] < plane) != (q[axis] < plane)]
        rising = p[axis] < q[axis]
        in_order = crossed if rising else crossed[::-1]
        refined += [(meeting(p, q, axis, planes[i]), {i, i + 1}) for i in in_order]
    for slab in range(len(planes) + 1):
        part = [point for point, bounded in refined if slab in bounded]
        part = [p for p, before in zip(part, [None, *part[:-1]], strict=True) if p != before]
        if part[0] == part[-1]:
            part.pop()
        if len(part) > 2:
            yield part


def meeting(p: Point, q: Point, axis: int, at: int) -> Point:
    """Where an edge meets a plane, rounded half up."""
    share = Fraction(at - p[axis], q[axis] - p[axis])
    x, y, z = (floor(a + share * (b - a) + Fraction(1, 2)) for a, b in zip(p, q, strict=True))
    return x, y, z
