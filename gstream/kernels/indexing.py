"""Kernels of ingest and of reading a stream: local indices of a chunk, and the stream's filters.

The filters are the compiled twins of gstream/formats/stream_filters.py: same names and arguments.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel
from gstream.kernels.edges import edge_codes as edge_codes
from gstream.kernels.edges import undo_edge_codes as undo_edge_codes

Array = NDArray[Any]

EMPTY = np.int32(-1)
ONE = np.uint64(1)
ZERO = np.uint64(0)
MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio: Knuth TAOCP vol. 3, section 6.4


@kernel
def index_chunk(
    triangles: Array, max_vertices: int, slots: Array, ids: Array, local: Array
) -> tuple[int, int]:
    """Number the vertices of consecutive triangles in order of first use, until the chunk is full.

    triangles : (n, 3) integer   global vertex ids; max_vertices : room in ids
    slots : (power of two,) int32   hash table, all EMPTY, at least 2 max_vertices, scratch
    ids : (max_vertices,) int64, local : (n, 3) uint16   written: global ids and local indices
    returns: (triangles taken, vertices); errors : none, ids are only compared
    source : open addressing with linear probing, Knuth TAOCP vol. 3, section 6.4, algorithm L
    """
    shift = np.uint64(64 - int(np.log2(slots.shape[0])))
    wrap = slots.shape[0] - 1
    count = 0
    for t in range(triangles.shape[0]):
        before = count
        for k in range(3):
            vertex = np.int64(triangles[t, k])
            slot = np.int64((np.uint64(vertex) * MIX) >> shift)
            at = slots[slot]
            while at >= 0 and ids[at] != vertex:
                slot = (slot + 1) & wrap
                at = slots[slot]
            if at < 0:
                if count == max_vertices:
                    return t, before
                at = count
                slots[slot] = at
                ids[at] = vertex
                count += 1
            local[t, k] = at
    return triangles.shape[0], count


@kernel
def weld_chunk(
    words: Array, max_vertices: int, slots: Array, ids: Array, local: Array
) -> tuple[int, int]:
    """`index_chunk` for a soup: corners with equal bits become one vertex.

    words : (3 n, w) uint32   all attributes of each corner, bit for bit
    slots : (power of two,) int32   hash table, all EMPTY, at least 2 max_vertices, scratch
    ids : (max_vertices,) int64, local : (n, 3) uint16   written: rows of words, local indices
    returns: (triangles taken, vertices); errors : none
    source : as index_chunk
    """
    shift = np.uint64(64 - int(np.log2(slots.shape[0])))
    wrap = slots.shape[0] - 1
    count = 0
    for t in range(local.shape[0]):
        before = count
        for k in range(3):
            row = 3 * t + k
            mixed = ZERO
            for w in range(words.shape[1]):
                mixed = (mixed ^ np.uint64(words[row, w])) * MIX
                mixed ^= mixed >> np.uint64(32)
            slot = np.int64((mixed * MIX) >> shift)
            at = slots[slot]
            while at >= 0 and not _equal(words, ids[at], row):
                slot = (slot + 1) & wrap
                at = slots[slot]
            if at < 0:
                if count == max_vertices:
                    return t, before
                at = count
                slots[slot] = at
                ids[at] = row
                count += 1
            local[t, k] = at
    return local.shape[0], count


@kernel
def _equal(words: Array, a: int, b: int) -> bool:
    """Whether rows a and b of words, (n, w) uint32, are the same; errors: none."""
    same = True
    for w in range(words.shape[1]):
        same = same and words[a, w] == words[b, w]
    return same


@kernel
def gather_rows(rows: Array, ids: Array, out: Array) -> None:
    """Copy the rows of a mapped, perhaps unaligned array: 4 to 7 times faster than rows[ids].

    rows : (v, 3) float, any strides; ids : (n,) int64, below v
    out : (n, 3) of the same dtype   written
    returns: nothing; errors : none, the caller checked the range of ids
    source : plain indexing
    """
    for i in range(ids.shape[0]):
        out[i, 0] = rows[ids[i], 0]
        out[i, 1] = rows[ids[i], 1]
        out[i, 2] = rows[ids[i], 2]


@kernel
def count_degenerate(positions: Array, triangles: Array) -> int:
    """Count triangles with two corners at the same place.

    positions : (v, 3) float; triangles : (t, 3) uint16, below v
    returns: int; errors : none
    source : spec/stream.md, "Degenerate triangles"; -0.0 equals +0.0
    """
    found = 0
    for t in range(triangles.shape[0]):
        a, b, c = np.int64(triangles[t, 0]), np.int64(triangles[t, 1]), np.int64(triangles[t, 2])
        ax, ay, az = positions[a, 0], positions[a, 1], positions[a, 2]
        bx, by, bz = positions[b, 0], positions[b, 1], positions[b, 2]
        cx, cy, cz = positions[c, 0], positions[c, 1], positions[c, 2]
        ab = (ax == bx) & (ay == by) & (az == bz)  # & and not `and`: 6 times faster, no branches
        bc = (bx == cx) & (by == cy) & (bz == cz)
        ca = (cx == ax) & (cy == ay) & (cz == az)
        found += ab | bc | ca
    return found


@kernel
def morton_of_points(points: Array, low: Array, scale: float, keys: Array) -> None:
    """Morton key of each point on a lattice of 2^21 cells per axis; non-finite points come last.

    points : (n, 3) float64, world units; low : (3,) float64, the corner of the lattice
    scale : float64   cells per world unit, so that points fall in 0 .. 2^21 - 1
    keys : (n,) uint64   written; bit 0 is x, bit 1 y, bit 2 z
    returns: nothing; errors : none
    source : Morton, "A computer oriented geodetic data base", 1966
    """
    for i in range(points.shape[0]):
        key = ZERO
        for axis in range(3):
            offset = (points[i, axis] - low[axis]) * scale
            if not (offset >= 0.0 and offset < 2097152.0):
                key = ~ZERO
                break
            cell = np.uint64(offset)
            cell = (cell | cell << np.uint64(32)) & np.uint64(0x1F00000000FFFF)
            cell = (cell | cell << np.uint64(16)) & np.uint64(0x1F0000FF0000FF)
            cell = (cell | cell << np.uint64(8)) & np.uint64(0x100F00F00F00F00F)
            cell = (cell | cell << np.uint64(4)) & np.uint64(0x10C30C30C30C30C3)
            cell = (cell | cell << np.uint64(2)) & np.uint64(0x1249249249249249)
            key |= cell << np.uint64(axis)
        keys[i] = key


@kernel
def corner_bases(triangles: Array, bases: Array) -> None:
    """Choose for each vertex one that comes before it and, if possible, shares a triangle with it.

    triangles : (t, 3) uint16   below v
    bases : (v,) int32   written: the highest corner below the vertex in the triangle that uses it
    first; without one, the vertex before; -1 for vertex 0
    returns: nothing; errors : none, the caller checked the range
    source : spec/stream.md, "Filters"
    """
    unseen = np.int32(-2)
    bases[:] = unseen
    for t in range(triangles.shape[0]):
        a, b, c = np.int32(triangles[t, 0]), np.int32(triangles[t, 1]), np.int32(triangles[t, 2])
        for _ in range(3):
            if bases[a] == unseen:
                best = max(b if b < a else -1, c if c < a else -1)
                bases[a] = best if best >= 0 else a - 1
            a, b, c = b, c, a
    for v in range(bases.shape[0]):
        if bases[v] == unseen:
            bases[v] = v - 1


@kernel
def delta_planes(values: Array, bases: Array, ordered: bool, planes: Array) -> None:
    """Difference to the base's value, zigzag, and one plane per byte.

    values : (n, c) unsigned of 1 to 8 bytes; ordered : they are the bits of IEEE floats
    bases : (n,) int32   an earlier row for each row; -1: the difference is to zero
    planes : (c, width, n) uint8   written; plane 0 holds the low bytes
    returns: nothing; errors : none, the caller gave planes the shape of values
    source : spec/stream.md, "Filters"
    """
    rows, width = values.shape[0], planes.shape[1]
    top = np.uint64(8 * width - 1)
    sign = ONE << top
    mask = (sign - ONE) | sign
    codes, zigzag = np.empty(rows, np.uint64), np.empty(rows, np.uint64)
    for c in range(planes.shape[0]):
        for i in range(rows):  # three short loops and not one: two of them become SIMD, 1.8 times
            code = np.uint64(values[i, c])
            if ordered:
                code = (~code & mask) if code & sign else code | sign
            codes[i] = code
        for i in range(rows):
            before = codes[bases[i]] if bases[i] >= 0 else ZERO
            step = (codes[i] - before) & mask
            zigzag[i] = ((step << ONE) ^ (ZERO - (step >> top))) & mask
        for byte in range(width):
            for i in range(rows):
                planes[c, byte, i] = np.uint8(zigzag[i] >> np.uint64(8 * byte))


@kernel
def undo_delta_planes(planes: Array, bases: Array, ordered: bool, values: Array) -> None:
    """Inverse of delta_planes.

    planes : (c, width, n) uint8; bases : (n,) int32, each below its own row
    ordered : values are the bits of IEEE floats
    values : (n, c) unsigned of `width` bytes   written
    returns: nothing; errors : none, every input decodes to something
    source : spec/stream.md, "Filters"
    """
    rows, width = values.shape[0], planes.shape[1]
    top = np.uint64(8 * width - 1)
    sign = ONE << top
    mask = (sign - ONE) | sign
    codes = np.empty(rows, np.uint64)
    for c in range(planes.shape[0]):
        codes[:] = ZERO
        for byte in range(width):
            for i in range(rows):
                codes[i] |= np.uint64(planes[c, byte, i]) << np.uint64(8 * byte)
        for i in range(rows):
            before = codes[bases[i]] if bases[i] >= 0 else ZERO
            codes[i] = before + ((codes[i] >> ONE) ^ (ZERO - (codes[i] & ONE)))
        for i in range(rows):
            code = codes[i] & mask
            if ordered:
                code = code ^ sign if code & sign else ~code & mask
            values[i, c] = code


@kernel
def first_use_planes(indices: Array, planes: Array) -> None:
    """Code each index as its distance below the high-water mark; 0 is the next new vertex.

    indices : (m,) uint16   numbered in order of first use
    planes : (2, m) uint8   written: low bytes, high bytes
    returns: nothing; errors : none
    source : sizes.md part B, "first use + high-water mark"
    """
    mark = 0
    for i in range(indices.shape[0]):
        code = mark - np.int64(indices[i])
        if code == 0:
            mark += 1
        planes[0, i] = np.uint8(code & 0xFF)
        planes[1, i] = np.uint8((code >> 8) & 0xFF)


@kernel
def undo_first_use_planes(planes: Array, vertices: int, indices: Array) -> int:
    """Inverse of first_use_planes.

    planes : (2, m) uint8; vertices : how many there are, at most 65 536
    indices : (m,) uint16   written
    returns: vertices used, or -1 for an index outside; errors : the caller compares it to vertices
    source : spec/stream.md, "Filters"
    """
    mark = 0
    for i in range(indices.shape[0]):
        code = int(planes[0, i]) | int(planes[1, i]) << 8
        index = mark - code
        if code == 0:
            if mark < vertices:
                mark += 1
            elif mark == 65_536:
                index = 0  # 65 536 below a full mark is written as 0 too
        if index < 0 or index >= vertices:
            return -1
        indices[i] = index
    return mark
