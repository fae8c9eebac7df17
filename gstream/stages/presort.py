"""Presort: the stream's triangles, snapped once, to cells on disk.

One unit reads a run of chunks and leaves one file with a segment per cell that it touched. Also
counts the triangles whose fate no single cell can tell: those that reach over several cells.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.errors import UnsupportedError, UsageError
from gstream.formats import cells
from gstream.formats.cells import SCENE, SEGMENT, SEGMENTS, Scene, grid_of_stream
from gstream.formats.stream import StreamReader
from gstream.formats.stream_chunk import DOMAIN_VERTEX, Chunk
from gstream.formats.stream_parts import warm_filters
from gstream.job import Job, Summary, Unit
from gstream.kernels import indexing as fast
from gstream.kernels.presort import (
    LARGE,
    OUTSIDE,
    SEGMENT_VERTICES,
    SPANNING,
    classify,
    index_segment,
    sort_by_cell,
)
from gstream.kernels.snap import snap
from gstream.kernels.voxelize import SPREAD, Rules, compact, fragments
from gstream.run.publish import Scratch

NAME = "3-presort"
UNIT_TRIANGLES = 1 << 19  # of a soup 32 MB of vertices and indices; with normals 12 MB more
LARGE_PAIRS = 1 << 18  # (large triangle, cell) pairs per flush
WHITE = np.uint32(0xFFFFFFFF)
COUNTS = ("triangles", "non_finite", "outside", "assigned", "unassigned", "degenerate")

Array = NDArray[Any]


def plan(job: Job) -> list[Unit]:
    """Runs of chunks of about UNIT_TRIANGLES; the grid travels in each unit."""
    reader = StreamReader(job.stream)
    scene = _scene(job, reader).to_json()
    totals = reader.chunks["triangles"].astype(np.int64)
    units: list[Unit] = []
    first, filled = 0, 0
    for chunk, triangles in enumerate(totals):
        filled += int(triangles)
        if filled >= UNIT_TRIANGLES or chunk == len(totals) - 1:
            number = len(units)
            data = (number, first, chunk + 1, scene)
            units.append(Unit(NAME, f"{number:06}", float(filled), 256 << 20, number, data))
            first, filled = chunk + 1, 0
    return units


def _scene(job: Job, reader: StreamReader) -> Scene:
    settings = job.voxelizing
    if reader.box is None:
        raise UsageError(f"{job.stream} has no triangles to voxelize")
    names = {attribute.name for attribute in reader.attributes}
    for missing in set(settings.required) - names:
        said = f"has no {missing}, which the scene requires"
        raise UnsupportedError(job.stream, said, "ingest a mesh with it, or change the scene")
    colours, normals = settings.stores("colour") and "colour" in names, settings.stores("normal")
    averaged = settings.lod and (colours or normals)
    input_normals = normals and settings.normals == "input"
    if input_normals and "normal" not in names:
        raise UsageError(
            f"{job.stream} has no normals", "leave out --normals input, or ingest a file with them"
        )
    low, high = reader.box
    box = ((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    grid = grid_of_stream(box, reader.metadata, settings)
    cell = max(settings.cell, settings.block, -(-grid.resolution // 256))
    return Scene(
        grid=grid,
        cell_bits=min((cell - 1).bit_length(), 8),
        colours=colours,
        normals=input_normals,
        box=box,
        metadata={k: v for k, v in reader.metadata.items() if k != "bounds"},
        counts={},
        weighted=averaged or settings.keep_weights or settings.columns is None,
        normal_column=normals,
    )


def work(job: Job, unit: Unit) -> None:
    """Snap, classify and scatter the triangles of a run of chunks."""
    _, first, last, text = unit.data
    scene = Scene.from_json(text)
    reader = StreamReader(job.stream, fast)
    mesh = _mesh(reader, first, last, scene)
    rules = _rules(job, scene)
    kinds = np.empty(len(mesh.triangles), np.uint8)
    keys = np.empty(len(mesh.triangles), np.uint32)
    bits = _cell_levels(scene)
    counts = np.zeros(8**bits, np.int64)
    sorting = (scene.grid.snap_bits, scene.cell_bits, scene.grid.resolution, rules.closed)
    degenerate = classify(mesh.vertices, mesh.triangles, sorting, SPREAD, kinds, keys, counts)
    fates = _fates(mesh, kinds, rules, scene)
    counted = {
        "outside": int(np.count_nonzero(kinds == OUTSIDE)) + fates["outside"],
        "assigned": fates["assigned"],
        "unassigned": fates["unassigned"],
        "degenerate": int(degenerate),
        "triangles": len(mesh.triangles),
    }
    name, index = f"{NAME}/{unit.name}.cells", f"{NAME}/{unit.name}.npy"
    rows: list[tuple[int, int, int, int, int, int]] = []
    with Scratch(job) as scratch:
        with scratch.write(name) as file:
            at = 0
            small = _small_segments(mesh, kinds, keys, counts, sorting)
            large = _large_segments(mesh, np.flatnonzero(kinds == LARGE), rules, scene)
            for cell, owners, points, indices in small:
                rows.append((cell, cells.SMALL, unit.data[0], len(owners), len(points), at))
                at += file.write(points.tobytes()) + file.write(indices.tobytes())
                at += file.write(mesh.extras[owners].tobytes())
            for cell, owners in large:
                rows.append((cell, cells.LARGE, unit.data[0], len(owners), 0, at))
                at += file.write(mesh.corners(owners).tobytes())
                at += file.write(mesh.extras[owners].tobytes())
        with scratch.write(index) as file:
            np.save(file, np.array(rows, SEGMENT))
        scratch.mark_done(unit, counted, (name, index))


@dataclass(frozen=True, slots=True)
class Mesh:
    """The snapped triangles of one unit."""

    vertices: Array  # (v, 3) i4, snap units in the grid
    triangles: Array  # (n, 3) u4 rows of vertices
    extras: Array  # (n, 3, words) u4 attribute words at the corners

    def corners(self, chosen: Array) -> Array:
        """(m, 3, 3) i4 corners of some triangles."""
        corners: Array = self.vertices[self.triangles[chosen]]
        return corners


def _small_segments(
    mesh: Mesh, kinds: Array, keys: Array, counts: Array, sorting: tuple[int, int, int, bool]
) -> Iterator[tuple[int, Array, Array, Array]]:
    """(cell, numbers of triangles, packed vertices, indices) of small triangles, cell by cell."""
    starts = np.cumsum(counts) - counts
    order = np.empty(int(counts.sum()), np.uint32)
    sort_by_cell(mesh.vertices, mesh.triangles, kinds, keys, sorting, SPREAD, starts.copy(), order)
    seen = np.zeros(len(mesh.vertices), np.uint32)
    places = np.empty(len(mesh.vertices), np.uint16)
    packed = np.empty(SEGMENT_VERTICES, np.uint64)
    indices = np.empty((int(counts.max(initial=0)), 3), np.uint16)
    edge = 1 << (sorting[0] + sorting[1])
    filled = np.flatnonzero(counts)
    lows = compact(filled.astype(np.uint32)).astype(np.int64) * edge - edge // 2
    segment = 0
    for cell, low in zip(filled.tolist(), lows, strict=True):
        chosen = order[int(starts[cell]) : int(starts[cell] + counts[cell])]
        while len(chosen):
            segment += 1
            taken, used = index_segment(
                mesh.vertices, mesh.triangles, chosen, low, segment, seen, places, packed, indices
            )
            yield cell, chosen[:taken], packed[:used], indices[:taken]
            chosen = chosen[taken:]


def finish(job: Job) -> Summary:
    """Publish the index of all segments and the scene."""
    units = plan(job)
    totals = StreamReader(job.stream).totals
    counts = dict.fromkeys(COUNTS, 0)
    with Scratch(job) as scratch:
        for counted in scratch.finished(units):
            for key, value in counted.items():
                counts[key] += value
        counts["non_finite"] = sum(int(s["non_finite"]) for s in totals["sources"])
        counts["triangles"] += counts["non_finite"]
        names = [f"{NAME}/{unit.name}.npy" for unit in units]
        segments = [np.load(scratch.path(name), allow_pickle=False) for name in names]
        merged = np.concatenate(segments)
        merged = merged[np.lexsort((merged["unit"], merged["kind"], merged["cell"]))]
        with scratch.write(f"{NAME}/{SEGMENTS}") as file:
            np.save(file, merged)
        scene = replace(Scene.from_json(units[0].data[3]), counts=counts)
        with scratch.write(f"{NAME}/{SCENE}") as file:
            file.write(scene.to_json().encode())
    return Summary(NAME, {**counts, "cells": len(np.unique(merged["cell"]))})


def warm() -> None:
    """Compile the kernels of this stage."""
    warm_filters(fast, packing=False)
    for dtype in (np.float32, np.float64):
        snap(np.zeros((1, 3), dtype), np.zeros(3), 1.0, np.zeros((1, 3), np.int64))
    vertices, triangles = np.zeros((1, 3), np.int32), np.zeros((1, 3), np.uint32)
    kinds, keys, counts = np.zeros(1, np.uint8), np.zeros(1, np.uint32), np.zeros(1, np.int64)
    classify(vertices, triangles, (12, 8, 256, False), SPREAD, kinds, keys, counts)
    for _ in _small_segments(
        Mesh(vertices, triangles, np.zeros((1, 3, 0), np.uint32)), kinds, keys, counts,
        (12, 8, 256, False),
    ):  # fmt: skip
        pass
    corners = np.zeros((1, 3, 3), np.int64)
    large = np.array([[[0, 0, 0], [1 << 17, 0, 0], [0, 1 << 17, 0]]], np.int64)
    both = np.concatenate([corners, large])  # one in a packet, one by itself
    for _ in fragments(both, Rules(12, "6", False, False), (8, 8, 8)):
        pass


def _rules(job: Job, scene: Scene) -> Rules:
    settings = job.voxelizing
    return Rules(
        scene.grid.snap_bits, settings.sep, settings.ties == "closed", settings.faces == "both"
    )


def _cell_levels(scene: Scene) -> int:
    return (scene.cells - 1).bit_length()


def _mesh(reader: StreamReader, first: int, last: int, scene: Scene) -> Mesh:
    """The snapped triangles of a run of chunks."""
    rows = reader.chunks[first:last]
    vertices = np.empty((int(rows["vertices"].sum(dtype=np.int64)), 3), np.int32)
    triangles = np.empty((int(rows["triangles"].sum(dtype=np.int64)), 3), np.uint32)
    extras = np.empty((len(triangles), 3, scene.words), np.uint32)
    grid = scene.grid
    origin, scale = np.array(grid.origin), 2.0**grid.snap_bits / grid.voxel_size
    wanted = [n for n, used in (("normal", scene.normals), ("colour", scene.colours)) if used]
    at, base = 0, 0
    for number in range(first, last):
        chunk = reader.chunk(number, wanted)
        count = len(chunk.positions)
        snapped = np.empty((count, 3), np.int64)
        snap(np.ascontiguousarray(chunk.positions), origin, scale, snapped)
        vertices[base : base + count] = snapped
        indices = chunk.triangles
        if indices is None:
            indices = np.arange(count, dtype=np.uint32).reshape(-1, 3)
        n = len(indices)
        np.add(indices, np.uint32(base), out=triangles[at : at + n])
        if scene.words:
            extras[at : at + n] = _words(chunk, indices, scene)
        at, base = at + n, base + count
    return Mesh(vertices, triangles, extras)


def _words(chunk: Chunk, rows: Array, scene: Scene) -> Array:
    """Attribute words of a chunk's triangle corners: RGBA, then the normal as 3 x i16."""
    parts = []
    if scene.colours:
        if chunk.colours is None:
            words = np.full((len(rows), 3), WHITE, np.uint32)
        else:
            codes = np.ascontiguousarray(chunk.colours).view("<u4")[:, 0]
            per_vertex = chunk.colour_domain == DOMAIN_VERTEX
            words = codes[rows] if per_vertex else np.broadcast_to(codes[:, None], (len(rows), 3))
        parts.append(words[:, :, None])
    if scene.normals:
        parts.append(_normal_words(chunk)[rows])
    return np.concatenate(parts, axis=2)


def _normal_words(chunk: Chunk) -> Array:
    """(v, 2) u4: input normals as 16-bit components of a unit vector; zero where unusable."""
    if chunk.normals is None:
        return np.zeros((len(chunk.positions), 2), np.uint32)
    normals = chunk.normals.astype(np.float64)
    length = np.sqrt((normals**2).sum(axis=1))
    usable = np.isfinite(length) & (length > 0)
    normals[~usable] = 0.0
    length[~usable] = 1.0
    codes = np.zeros((len(normals), 4), "<i2")
    codes[:, :3] = np.floor(normals / length[:, None] * 32767.0 + 0.5)
    return codes.view("<u4")


def _large_segments(
    mesh: Mesh, large: Array, rules: Rules, scene: Scene
) -> Iterator[tuple[int, Array]]:
    """(cell, triangles) for the triangles that are larger than half a cell."""
    if not len(large):
        return
    coarse = Rules(rules.snap_bits + scene.cell_bits, "conservative", True, False)
    owners: list[Array] = []
    keys: list[Array] = []
    pairs = 0
    at_cells = fragments(mesh.corners(large).astype(np.int64), coarse, (scene.cells,) * 3)
    for some_owners, some_keys, _ in at_cells:
        owners.append(large[some_owners])
        keys.append(some_keys)
        pairs += len(some_keys)
        if pairs >= LARGE_PAIRS:
            yield from _by_cell(np.concatenate(owners), np.concatenate(keys))
            owners, keys, pairs = [], [], 0
    if pairs:
        yield from _by_cell(np.concatenate(owners), np.concatenate(keys))


def _by_cell(owners: Array, keys: Array) -> Iterator[tuple[int, Array]]:
    order = np.argsort(keys, kind="stable")
    owners, keys = owners[order], keys[order]
    starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    for a, b in zip(starts, [*starts[1:], len(keys)], strict=True):
        yield int(keys[a]), owners[a:b]


def _fates(mesh: Mesh, kinds: Array, rules: Rules, scene: Scene) -> dict[str, int]:
    """Assigned, unassigned and outside among the triangles that reach over several cells."""
    spanning, large = np.flatnonzero(kinds == SPANNING), np.flatnonzero(kinds == LARGE)
    if rules.sep == "conservative" and not scene.cropped:
        return {"assigned": len(spanning) + len(large), "unassigned": 0, "outside": 0}
    met, touched = _meets_small(mesh.corners(spanning).astype(np.int64), rules, scene)
    for t in range(len(large)):
        some_met, some_touched = _meets_large(
            mesh.corners(large[t : t + 1]).astype(np.int64), rules, scene
        )
        met, touched = met + some_met, touched + some_touched
    total = len(spanning) + len(large)
    return {"assigned": met, "unassigned": touched - met, "outside": total - touched}


def _meets_small(corners: Array, rules: Rules, scene: Scene) -> tuple[int, int]:
    """How many triangles meet a target, and how many meet a voxel of the grid."""
    base = (corners.min(axis=1) >> rules.snap_bits) - 1
    local = corners - (base << rules.snap_bits)[:, None, :]
    met, touched = np.zeros(len(corners), np.bool_), np.zeros(len(corners), np.bool_)
    for owners, keys, hits in fragments(local, rules, (256, 256, 256)):
        if scene.cropped:
            voxel = compact(keys) + base[owners]
            inside = ((voxel >= 0) & (voxel < scene.grid.resolution)).all(axis=1)
            owners, hits = owners[inside], hits[inside]
        touched[owners] = True
        met[owners[hits]] = True
    return int(met.sum()), int(touched.sum())


def _meets_large(corner: Array, rules: Rules, scene: Scene) -> tuple[int, int]:
    """The same for one large triangle: cell by cell, up to the first target met."""
    coarse = Rules(rules.snap_bits + scene.cell_bits, "conservative", True, False)
    touched = 0
    for _, keys, _ in fragments(corner, coarse, (scene.cells,) * 3):
        for cell in compact(keys) << scene.cell_bits:
            room = np.minimum(scene.grid.resolution - cell, 1 << scene.cell_bits)
            local = corner - (cell << rules.snap_bits)
            for _, _, hits in fragments(local, rules, (int(room[0]), int(room[1]), int(room[2]))):
                touched = 1
                if hits.any():
                    return 1, 1
    return 0, touched
