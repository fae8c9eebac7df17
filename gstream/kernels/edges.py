"""Kernels that code a chunk's triangles by shared edges: the stream's filter 6.

The compiled twins of gstream/formats/stream_edges.py: same names and arguments.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel

Array = NDArray[Any]

FIFO = 16  # edges; 32 and 64 gain under 2 % on scans, nothing on CAD
MISS = 255
SAMPLE = 2048  # triangles that decide whether edge codes are worth their time


@kernel
def edge_codes(triangles: Array, codes: Array, extra: Array) -> int:
    """Code each triangle by an edge that it shares with one of the last triangles.

    triangles : (t, 3) uint16   numbered in order of first use
    codes : (t,) uint8   written: 255, or 2 (3 slot + corner) + 1 for a third vertex that is known
    extra : (3 t,) uint16   written: distances below the mark
    returns: how many extras there are; -1 when fewer than half of the first triangles share an edge
    errors : none
    source : Meshoptimizer's index codec (Kapoulkine 2017), spec/stream.md, "Filters"
    """
    edges = np.full(FIFO, -1, np.int64)
    head = mark = used = hits = 0
    for t in range(triangles.shape[0]):
        a, b, c = np.int64(triangles[t, 0]), np.int64(triangles[t, 1]), np.int64(triangles[t, 2])
        slot, corner = _find_edge(edges, head, a, b, c)
        if slot >= 0:
            hits += 1
            if corner == 1:
                a, b, c = b, c, a
            elif corner == 2:
                a, b, c = c, a, b
            codes[t] = 2 * (3 * slot + corner) + (c != mark)
        else:
            codes[t] = MISS
            extra[used], extra[used + 1] = mark - a, mark + (a == mark) - b
            mark += a == mark
            mark += b == mark
            used += 2
            edges[head & 15] = b << 16 | a
            head += 1
        if slot < 0 or c != mark:
            extra[used] = mark - c
            used += 1
        mark += c == mark
        edges[head & 15] = c << 16 | b
        edges[(head + 1) & 15] = a << 16 | c
        head += 2
        if t == min(SAMPLE, triangles.shape[0]) - 1 and 2 * hits <= t:
            return -1
    return used


@kernel
def _find_edge(edges: Array, head: int, a: int, b: int, c: int) -> tuple[int, int]:
    """The youngest slot that holds an edge of a triangle, and the edge's first corner; or -1, 0.

    edges : (16,) int64   first << 16 | second, a ring whose next free place is head & 15
    """
    first, second, third = a << 16 | b, b << 16 | c, c << 16 | a
    for slot in range(FIFO):
        edge = edges[(head - 1 - slot) & 15]
        if edge == first:
            return slot, 0
        if edge == second:
            return slot, 1
        if edge == third:
            return slot, 2
    return -1, 0


@kernel
def undo_edge_codes(codes: Array, extra: Array, vertices: int, indices: Array) -> int:
    """Inverse of edge_codes.

    codes : (t,) uint8; extra : (m,) uint16; vertices : how many there are, at most 65 536
    indices : (3 t,) uint16   written
    returns: vertices used, or -1 for broken codes; errors : the caller compares it to vertices
    source : spec/stream.md, "Filters"
    """
    edges = np.full(FIFO, -1, np.int64)
    head = mark = used = 0
    found = np.zeros(3, np.int64)
    for t in range(codes.shape[0]):
        code = int(codes[t])
        fresh = 3
        corner = 0
        if code != MISS:
            slot, corner = code // 6, code // 2 % 3
            edge = edges[(head - 1 - slot) & 15] if slot < FIFO else -1
            if edge < 0 or (code & 1 == 0 and mark == vertices):
                return -1
            found[0], found[1] = edge >> 16, edge & 0xFFFF
            fresh = 1
        for k in range(3 - fresh, 3):
            below = 0
            if code == MISS or code & 1:
                if used == extra.shape[0]:
                    return -1
                below = int(extra[used])
                used += 1
            found[k] = mark - below
            if below == 0 and mark < vertices:
                mark += 1
            elif below == 0 and mark == 65_536:
                found[k] = 0
            if found[k] < 0 or found[k] >= vertices:
                return -1
        a, b, c = found[0], found[1], found[2]
        indices[3 * t + corner] = a
        indices[3 * t + (corner + 1) % 3] = b
        indices[3 * t + (corner + 2) % 3] = c
        if code == MISS:
            edges[head & 15] = b << 16 | a
            head += 1
        edges[head & 15] = c << 16 | b
        edges[(head + 1) & 15] = a << 16 | c
        head += 2
    return mark if used == extra.shape[0] else -1
