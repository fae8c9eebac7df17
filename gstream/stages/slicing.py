"""Slices of one mesh as chunks: index, gather, drop what is not finite, weld soups.

No file is written here; ingest.py encodes and stores what comes out.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import InputError
from gstream.formats.stream_chunk import (
    DOMAIN_TRIANGLE,
    DOMAIN_VERTEX,
    MAX_CHUNK_TRIANGLES,
    MAX_CHUNK_VERTICES,
    Chunk,
)
from gstream.kernels import indexing
from gstream.kernels.indexing import EMPTY
from gstream.kernels.neighbours import follow_edges
from gstream.readers.mesh import DiskArray, Mesh

SLOTS: Final = 4 * MAX_CHUNK_VERTICES  # hash slots: at most a quarter is taken, 1 MiB
MORTON_CELLS: Final = 2.0**21 - 1
INDEX_BYTES: Final = 6  # a triangle's three u16
SCATTERED: Final = 0.75  # vertices per triangle; one piece of a surface has little over a half

Array = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """The triangles of one unit, in the order in which they will be stored."""

    mesh: Mesh
    source: int
    triangles: Array | None  # (n, 3) uint32 or int64 vertex ids in range; None: a soup
    numbers: Array | None  # (n,) number of each triangle in the mesh; None: first, first + 1, ...
    first: int
    count: int

    def part(self, start: int, stop: int) -> "Slice":
        return replace(
            self,
            triangles=None if self.triangles is None else self.triangles[start:stop],
            numbers=None if self.numbers is None else self.numbers[start:stop],
            first=self.first + start,
            count=stop - start,
        )

    def rows(self) -> Array | slice:
        """What picks these triangles from an array that has one row per triangle."""
        return slice(self.first, self.first + self.count) if self.numbers is None else self.numbers


@dataclass(frozen=True, slots=True, eq=False)
class _Local:
    """One chunk in the making: its vertices are numbered by first use."""

    ids: Array  # (v,) int64 rows of the mesh's vertices, or of a soup's corners in the slice
    triangles: Array  # (t, 3) uint16 rows of ids
    positions: Array  # (v, 3)
    normals: Array | None
    colours: Array | None  # (v, 4)


def slice_of(mesh: Mesh, source: int, first: int, count: int, order: str) -> Slice:
    """Triangles first .. first + count of the mesh; order: file | spatial."""
    work = Slice(mesh, source, _triangles(mesh, first, count), None, first, count)
    return _sorted_by_place(work) if order == "spatial" else work


def chunks_of(work: Slice, chunk_triangles: int) -> Iterator[Chunk]:
    """Cut a slice into chunks; their counters cover all its triangles."""
    at = dropped = 0
    while at < work.count:
        window = work.part(at, min(work.count, at + chunk_triangles))
        taken, chunk = _chunk(window)
        if work.numbers is not None or _scattered(chunk):
            chunk = _along_edges(chunk)
        at += taken
        dropped += chunk.non_finite
        if chunk.triangle_count:
            yield replace(chunk, non_finite=dropped)
            dropped = 0
    if dropped:
        empty = np.zeros((0, 3), _native(work.mesh.positions))
        yield Chunk(empty, source=work.source, non_finite=dropped)


def _chunk(window: Slice) -> tuple[int, Chunk]:
    """The first chunk of the window, and how many triangles went into it or were dropped."""
    local = _weld(window) if window.triangles is None else _index(window)
    taken = len(local.triangles)
    finite = np.isfinite(local.positions)
    keep: Array | None = None
    if not finite.all():
        keep = np.logical_and.reduce(finite, axis=1)[local.triangles].all(axis=1)
        local = _only(local, keep)
    triangle_colours = _triangle_colours(window.part(0, taken), keep)
    chunk = Chunk(
        positions=local.positions,
        triangles=local.triangles,
        normals=local.normals,
        colours=local.colours if triangle_colours is None else triangle_colours,
        colour_domain=DOMAIN_VERTEX if triangle_colours is None else DOMAIN_TRIANGLE,
        source=window.source,
        non_finite=taken - len(local.triangles),
        degenerate=indexing.count_degenerate(local.positions, local.triangles),
    )
    return taken, _smaller(chunk)


def _triangles(mesh: Mesh, first: int, count: int) -> Array | None:
    """Vertex ids of a range of triangles, checked against the vertex count."""
    if mesh.triangles is None:
        return None
    mapped = mesh.triangles.map()[first : first + count]
    ids = np.ascontiguousarray(mapped, _native(mesh.triangles))
    if int(ids.min()) < 0 or int(ids.max()) >= mesh.vertex_count:
        bad = np.flatnonzero((ids < 0) | (ids >= mesh.vertex_count))[0]
        what = "face" if mesh.faces == mesh.triangle_count else "triangle"
        said = f"vertex {ids.flat[bad]} of {mesh.vertex_count} (counted from 0)"
        place = f"{what} {first + int(bad) // 3} (counted from 0)"
        raise InputError(mesh.name, place, f"there is no {said}", "repair or export the mesh again")
    if mesh.vertex_count > 1 << 32:
        return ids.astype(np.int64, copy=False)
    return ids.view(np.uint32) if ids.itemsize == 4 else ids.astype(np.uint32)


def _index(window: Slice) -> _Local:
    triangles, mesh = window.triangles, window.mesh
    if triangles is None:
        raise TypeError("a soup has no triangles to index")
    slots = np.full(SLOTS, EMPTY)
    ids = np.empty(MAX_CHUNK_VERTICES, np.int64)
    local = np.empty((len(triangles), 3), np.uint16)
    taken, count = indexing.index_chunk(triangles, len(ids), slots, ids, local)
    ids = ids[:count]
    return _Local(
        ids,
        local[:taken],
        _gather(mesh.positions, ids),
        None if mesh.normals is None else _gather(mesh.normals, ids),
        None if mesh.colours is None else _rgba(mesh.colours.map()[ids]),
    )


def _weld(window: Slice) -> _Local:
    """Corners of a soup whose bits are all equal become one vertex of the chunk."""
    mesh = window.mesh
    rows = window.rows()
    positions = _native_copy(mesh.positions.map()[rows]).reshape(-1, 3)
    normals = None if mesh.normals is None else _native_copy(_by_corner(mesh.normals, rows))
    colours = None if mesh.colours is None else _rgba(_by_corner(mesh.colours, rows))
    given = [array for array in (positions, normals, colours) if array is not None]
    words = np.concatenate([np.ascontiguousarray(a).view(np.uint32) for a in given], axis=1)
    slots = np.full(SLOTS, EMPTY)
    ids = np.empty(MAX_CHUNK_VERTICES, np.int64)
    local = np.empty((window.count, 3), np.uint16)
    taken, count = indexing.weld_chunk(words, len(ids), slots, ids, local)
    ids = ids[:count]
    return _Local(
        ids,
        local[:taken],
        positions[ids],
        None if normals is None else normals[ids],
        None if colours is None else colours[ids],
    )


def _by_corner(array: DiskArray, rows: Array | slice) -> Array:
    """Rows 3t, 3t + 1, 3t + 2 of an array with one row per corner of a soup."""
    if isinstance(rows, slice):
        return array.map()[3 * rows.start : 3 * rows.stop]
    return array.map()[(3 * rows[:, None] + np.arange(3)).ravel()]


def _only(local: _Local, keep: Array) -> _Local:
    """The kept triangles, and only the vertices that they use."""
    slots = np.full(SLOTS, EMPTY)
    ids = np.empty(MAX_CHUNK_VERTICES, np.int64)
    triangles = np.empty((int(keep.sum()), 3), np.uint16)
    wide = local.triangles[keep].astype(np.uint32)
    _, count = indexing.index_chunk(wide, len(ids), slots, ids, triangles)
    used = ids[:count]
    return _Local(
        local.ids[used],
        triangles,
        local.positions[used],
        None if local.normals is None else local.normals[used],
        None if local.colours is None else local.colours[used],
    )


def _triangle_colours(window: Slice, keep: Array | None) -> Array | None:
    array = window.mesh.triangle_colours
    if array is None:
        return None
    colours = _rgba(array.map()[window.rows()])
    return colours if keep is None else colours[keep]


def _smaller(chunk: Chunk) -> Chunk:
    """The chunk with or without indices, whichever has fewer bytes before packing."""
    triangles = chunk.triangles
    per_vertex = [chunk.positions, chunk.normals]
    if chunk.colour_domain == DOMAIN_VERTEX:
        per_vertex.append(chunk.colours)
    width = sum(a.itemsize * a.shape[1] for a in per_vertex if a is not None)
    if triangles is None or 3 * len(triangles) > MAX_CHUNK_VERTICES:
        return chunk
    saved = (3 * len(triangles) - len(chunk.positions)) * width
    if saved > INDEX_BYTES * len(triangles):
        return chunk
    corners = triangles.ravel()
    colours = chunk.colours
    if colours is not None and chunk.colour_domain == DOMAIN_VERTEX:
        colours = colours[corners]
    return replace(
        chunk,
        triangles=None,
        positions=chunk.positions[corners],
        normals=None if chunk.normals is None else chunk.normals[corners],
        colours=colours,
    )


def _scattered(chunk: Chunk) -> bool:
    """Whether a chunk is of many small pieces: in an order of its own it is a third smaller."""
    return len(chunk.positions) > SCATTERED * chunk.triangle_count


def _along_edges(chunk: Chunk) -> Chunk:
    """The same triangles, each next to a neighbour; their indices shrink to a third or less."""
    if chunk.triangles is None:
        return chunk
    order = np.empty(len(chunk.triangles), np.int64)
    ids = np.empty(len(chunk.positions), np.int64)
    triangles = np.empty_like(chunk.triangles)
    follow_edges(chunk.triangles, order, ids, triangles)
    colours = chunk.colours
    if colours is not None:
        colours = colours[ids if chunk.colour_domain == DOMAIN_VERTEX else order]
    return replace(
        chunk,
        triangles=triangles,
        positions=chunk.positions[ids],
        normals=None if chunk.normals is None else chunk.normals[ids],
        colours=colours,
    )


def _sorted_by_place(work: Slice) -> Slice:
    """The same triangles in Morton order of their centroids; ties keep the file's order."""
    sums = np.zeros((work.count, 3))
    step = MAX_CHUNK_TRIANGLES
    for at in range(0, work.count, step):
        window = work.part(at, min(work.count, at + step))
        if window.triangles is None:
            corners = window.mesh.positions.map()[window.rows()]
        else:
            ids = window.triangles.astype(np.int64).ravel()
            corners = _gather(window.mesh.positions, ids).reshape(-1, 3, 3)
        with np.errstate(over="ignore", invalid="ignore"):
            a, b, c = corners.astype(np.float64).transpose(1, 0, 2)
            sums[at : at + window.count] = a + b + c
    keys = np.empty(work.count, np.uint64)
    with np.errstate(over="ignore", invalid="ignore"):
        whole = np.isfinite(sums[:, 0] + sums[:, 1] + sums[:, 2])
        axes = sums[whole].T.copy()  # reducing long axes is 8 times faster
        low = axes.min(axis=1) if axes.size else np.zeros(3)
        extent = float((axes.max(axis=1) - low).max()) if axes.size else 0.0
    scale = MORTON_CELLS / extent if 0.0 < extent < np.inf else 0.0
    indexing.morton_of_points(sums, low, scale, keys)
    order = np.argsort(keys, kind="stable")
    triangles = None if work.triangles is None else work.triangles[order]
    return replace(work, triangles=triangles, numbers=work.first + order)


def _native(array: DiskArray) -> np.dtype[Any]:
    return np.dtype(array.dtype).newbyteorder("=")


def _native_copy(array: Array) -> Array:
    return np.ascontiguousarray(array, array.dtype.newbyteorder("="))


def _gather(array: DiskArray, ids: Array) -> Array:
    rows = array.map()
    if not rows.dtype.isnative:
        return _native_copy(rows[ids])
    out = np.empty((len(ids), 3), rows.dtype)
    indexing.gather_rows(rows, ids, out)
    return out


def _rgba(colours: Array) -> Array:
    """(n, 3) or (n, 4) uint8 -> (n, 4) uint8, opaque where the file has no alpha."""
    if colours.shape[1] == 4:
        return np.ascontiguousarray(colours)
    full = np.full((len(colours), 4), 255, np.uint8)
    full[:, :3] = colours
    return full


def warm_slicing() -> None:
    """Compile every kernel of slicing for the dtypes of usual meshes; takes seconds once."""
    slots = np.full(SLOTS, EMPTY)
    ids = np.empty(4, np.int64)
    local = np.zeros((1, 3), np.uint16)
    for dtype in (np.uint32, np.int64):
        triangles = np.zeros((1, 3), dtype)
        for writeable in (True, False):  # ids that lie in a file as they are needed stay there
            triangles.flags.writeable = writeable
            slots[:] = EMPTY
            indexing.index_chunk(triangles, 4, slots, ids, local)
    slots[:] = EMPTY
    indexing.weld_chunk(np.zeros((3, 3), np.uint32), 4, slots, ids, local)
    follow_edges(local, np.empty(1, np.int64), ids, local.copy())
    indexing.morton_of_points(np.zeros((1, 3)), np.zeros(3), 1.0, np.zeros(1, np.uint64))
    for type_, width in ((np.float32, 4), (np.float64, 8)):
        points = np.zeros((3, 3), type_)
        indexing.count_degenerate(points, local)
        for start in (0, 1):  # an array in a file may start at any byte
            data = np.zeros(40 * width, np.uint8)
            data.flags.writeable = False
            for stride in (3 * width, 4 * width):
                rows: Array = np.ndarray((3, 3), type_, data, start, (stride, width))
                indexing.gather_rows(rows, np.zeros(1, np.int64), points[:1])
