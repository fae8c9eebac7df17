"""The edge codes of a geometry stream in plain Python: slow, readable, for checks and tests.

Its compiled twin is in gstream/kernels/indexing.py. spec/stream.md, "Edge codes". The idea is that
of Meshoptimizer's index codec (Kapoulkine 2017).
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Triangle = tuple[int, int, int]

FIFO: Final = 16  # edges that are remembered
MISS: Final = 255
SAMPLE: Final = 2048  # triangles that decide whether edge codes are worth their time
FULL: Final = 65_536


class _Edges:
    """The last edges, youngest first, each in the direction that a neighbour would have."""

    def __init__(self) -> None:
        self.edges: list[tuple[int, int]] = []

    def add(self, triangle: Triangle, known: bool) -> None:
        """The edges of a triangle a, b, c; known: that from a to b was found here."""
        a, b, c = triangle
        new = [(a, c), (c, b)] if known else [(a, c), (c, b), (b, a)]
        self.edges = (new + self.edges)[:FIFO]

    def find(self, triangle: Triangle) -> tuple[int, int] | None:
        """The youngest slot that has an edge of the triangle, and that edge's first corner."""
        own = [(triangle[k], triangle[(k + 1) % 3]) for k in range(3)]
        for slot, edge in enumerate(self.edges):
            if edge in own:
                return slot, own.index(edge)
        return None


def edge_codes(triangles: Array, codes: Array, extra: Array) -> int:
    """Code each triangle by an edge that it shares with one of the last ones.

    triangles : (t, 3) uint16, numbered in order of first use
    codes : (t,) uint8, extra : (3 t,) uint16, written
    returns: how many extras there are; -1 when fewer than half of the first triangles share an edge
    """
    last, mark, hits = _Edges(), 0, 0
    below: list[int] = []
    for t, (x, y, z) in enumerate(triangles.tolist()):
        place = last.find((x, y, z))
        corner = place[1] if place else 0
        a, b, c = ((x, y, z), (y, z, x), (z, x, y))[corner]
        if place:
            hits += 1
            codes[t] = 2 * (3 * place[0] + corner) + (c != mark)
        else:
            codes[t] = MISS
        for vertex in (c,) if place else (a, b, c):
            if place is None or vertex != mark:
                below.append((mark - vertex) % FULL)
            mark += vertex == mark
        last.add((a, b, c), place is not None)
        if t == min(SAMPLE, len(triangles)) - 1 and 2 * hits <= t:
            return -1
    extra[: len(below)] = below
    return len(below)


def undo_edge_codes(codes: Array, extra: Array, vertices: int, indices: Array) -> int:
    """Inverse of `edge_codes`: indices (3 t,) uint16, written.

    returns: the number of vertices used; any other than `vertices`, or -1, means a broken part
    """
    last, mark = _Edges(), 0
    below = iter(extra.tolist())
    found: list[int] = []
    for code in codes.tolist():
        slot, corner, hit = code // 6, code // 2 % 3, code != MISS
        if hit and (slot >= len(last.edges) or (code % 2 == 0 and mark == vertices)):
            return -1
        triangle = list(last.edges[slot]) if hit else []
        while len(triangle) < 3:
            down = next(below, None) if code % 2 else 0
            if down is None:
                return -1
            triangle.append(0 if down == 0 and mark == FULL else mark - down)
            mark += down == 0 and mark < vertices
            if not 0 <= triangle[-1] < vertices:
                return -1
        a, b, c = triangle
        found += ((a, b, c), (c, a, b), (b, c, a))[corner if hit else 0]
        last.add((a, b, c), hit)
    indices[:] = np.array(found, np.uint16)
    return mark if next(below, None) is None else -1
