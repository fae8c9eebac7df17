"""Voxelize: cells on disk to piles of finished blocks, level 0 and the levels inside a cell.

A unit is a run of cells in Morton order. Triangles stream through a cell; only its voxels take
memory, and a cell whose voxels exceed the budget is filled in eight parts, down to single blocks.
The levels up to the one whose blocks are cells are made while the blocks below are in memory.
"""

from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.errors import RefusedError
from gstream.formats.cells import LARGE, SCENE, SEGMENT, SEGMENTS, Scene
from gstream.formats.columns import Block
from gstream.formats.lodrule import COLOUR_TABLES, LINEAR_OF_CODE
from gstream.formats.pieces import Pieces
from gstream.formats.pile import PileWriter
from gstream.job import Job, Summary, Unit
from gstream.kernels import pieces
from gstream.kernels.accumulate import AREA, HIT
from gstream.kernels.lod import finish_voxels
from gstream.kernels.presort import gather, unpack, within
from gstream.kernels.select import sum_areas
from gstream.kernels.voxelize import Box, BoxFullError, Rules, compact
from gstream.run.publish import Scratch
from gstream.stages import levels
from gstream.stages.levels import LevelPile, coarsest_level, job_columns
from gstream.stages.piece_buffer import PieceBuffer

NAME = "4-voxelize"
SOURCE = "3-presort"
UNIT_TRIANGLES = 1 << 17
UNIT_CELLS = 16
BATCH_TRIANGLES = 1 << 15  # unpacked at once: 5 MB of corners and channels
UNIT_BYTES = 64 << 20  # what a unit takes besides the box: batches, one block being encoded
LEAST_BOX_BYTES = 16 << 20  # a full block of 64^3 voxels with colours
COUNTS = ("assigned", "unassigned", "fragments", "area_total", "area_pruned", "voxels")
PIECE_COUNTS = ("pieces", "pieces_left_out")

Array = NDArray[Any]
Filled = tuple[int, Block, Pieces]  # key, voxels, source triangles where these are kept


def plan(job: Job) -> list[Unit]:
    """Runs of cells in Morton order, up to UNIT_TRIANGLES or UNIT_CELLS."""
    with Scratch(job) as scratch:
        segments = _segments(scratch)
    cells, starts = np.unique(segments["cell"], return_index=True)
    ends = np.append(starts[1:], len(segments))
    units: list[Unit] = []
    first, triangles = 0, 0
    for i in range(len(cells)):
        triangles += int(segments["count"][starts[i] : ends[i]].sum())
        full = triangles >= UNIT_TRIANGLES or i - first + 1 >= UNIT_CELLS
        if full or i == len(cells) - 1:
            run = (int(starts[first]), int(ends[i]))
            units.append(
                Unit(NAME, f"{len(units):06}", float(triangles), 0, int(cells[first]), run)
            )
            first, triangles = i + 1, 0
    return units


def work(job: Job, unit: Unit) -> None:
    """Voxelize a run of cells into one pile."""
    settings = job.voxelizing
    name = f"{NAME}/{unit.name}.gsp"
    with Scratch(job) as scratch:
        scene = _scene(scratch)
        counts = dict.fromkeys(COUNTS + (PIECE_COUNTS if settings.keep_geometry else ()), 0)
        segments = _segments(scratch)[unit.data[0] : unit.data[1]]
        log2_block = settings.block.bit_length() - 1
        top = min(scene.cell_bits - log2_block, coarsest_level(settings, scene))
        columns = job_columns(settings, scene)
        with scratch.write(name) as file, PileWriter(file, columns) as pile:
            above = LevelPile(pile, settings, scene, top)
            for cell in np.unique(segments["cell"]):
                filling = Filling(job, scene, scratch, segments[segments["cell"] == cell], counts)
                for key, block, pieces in filling.blocks():
                    above.write(key, 0, block, pieces=pieces)
            above.close()
        scratch.mark_done(unit, counts, (name,))


def finish(job: Job) -> Summary:
    """Sum the counts; the piles are found by merge."""
    with Scratch(job) as scratch:
        done = scratch.finished(plan(job))
    _box.cache_clear()
    totals = Counter[str]()
    for counts in done:
        totals.update(counts)
    return Summary(NAME, dict(sorted(totals.items())))


def warm() -> None:
    """Compile the kernels of this stage."""
    levels.warm()
    pieces.warm()
    large = [[0, 0, 0], [40000, 100, 100], [100, 40000, 9000]]
    corners = np.array([large, [[0, 0, 0], [4000, 0, 0], [0, 4000, 900]]], np.int64)
    for channels in (0, 4):
        box = Box(channels)
        box.start(Rules(12, "6", False, False), 8)
        box.add(corners, np.zeros((2, 3, channels)))
        rows, _ = box.collect(0, 1)
        finish_voxels(rows, box.sums, box.flags, channels == 4, False, 11, COLOUR_TABLES)
        sum_areas(box.sums, box.flags)
    points = np.zeros((2, 3), np.int64)
    unpack(np.frombuffer(bytes(16), "<u8"), 0, np.zeros(3, np.int64), points)
    gather(np.frombuffer(bytes(12), "<u2").reshape(2, 3), points, corners)
    within(corners, 12, False, np.zeros(3, np.int64), np.ones(3, np.int64), np.zeros(2, np.bool_))


class Filling:
    """One cell being voxelized: its triangles, its boxes, its counts."""

    def __init__(
        self, job: Job, scene: Scene, scratch: Scratch, segments: Array, counts: dict[str, int]
    ) -> None:
        self.settings, self.scene, self.scratch = job.voxelizing, scene, scratch
        self.segments, self.counts = segments, counts
        self.cell = int(segments["cell"][0])
        self.low = compact(np.array([self.cell], np.uint32))[0] << scene.cell_bits
        self.room = np.minimum(scene.grid.resolution - self.low, 1 << scene.cell_bits)
        shares = 4 if self.settings.keep_geometry else 2  # a box takes two of them when it grows
        self.limit_bytes = max((job.worker_memory - UNIT_BYTES) // shares, LEAST_BOX_BYTES)
        self.rules = Rules(
            scene.grid.snap_bits,
            self.settings.sep,
            self.settings.ties == "closed",
            self.settings.faces == "both",
        )
        total = int(segments["count"].sum())
        self.single = np.zeros(total, np.bool_)  # triangles that no other cell sees
        self.met = np.zeros(total, np.bool_)

    def blocks(self) -> Iterator[Filled]:
        """Finished level-0 blocks of the cell in Morton order."""
        yield from self._fill(np.zeros(3, np.int64), 1 << self.scene.cell_bits, self.cell)
        self.counts["assigned"] += int(np.count_nonzero(self.single & self.met))
        self.counts["unassigned"] += int(np.count_nonzero(self.single & ~self.met))

    def _fill(self, low: Array, edge: int, key: int) -> Iterator[Filled]:
        """low : box in the cell, voxels; key : Morton code of the box among boxes of its size."""
        room = np.minimum(self.scene.grid.resolution - (self.low + low), edge)
        if (room <= 0).any():
            return
        box = _box(self.scene.channels)
        box.start(self.rules, edge, (int(room[0]), int(room[1]), int(room[2])), self.limit_bytes)
        log2_edge, k = self.settings.block.bit_length() - 1, self.rules.snap_bits
        buffer = PieceBuffer(log2_edge + k, room << k, 2 * self.limit_bytes)
        try:
            self._add_triangles(box, buffer, low)
        except BoxFullError:
            if edge == self.settings.block:
                raise RefusedError(
                    f"one block of {edge}^3 voxels does not fit the memory of a worker",
                    "give more --memory, fewer --workers, or a smaller --block",
                ) from None
            del buffer
            half = edge // 2
            for octant in range(8):
                corner = np.array([octant & 1, octant >> 1 & 1, octant >> 2], np.int64) * half
                yield from self._fill(low + corner, half, 8 * key + octant)
            return
        total, pruned = sum_areas(box.sums[: box.voxels], box.flags[: box.voxels])
        self.counts["area_total"] += total
        self.counts["area_pruned"] += pruned
        self.counts["fragments"] += box.fragments
        parts = (edge // self.settings.block) ** 3
        filled = (box.tile_slots.reshape(parts, -1) >= 0).any(axis=1)
        cut = buffer.by_block()
        for part in np.flatnonzero(filled).tolist():
            here = cut.take(part)
            block = self._block(box, part, parts, len(here.triangles) > 0)
            if block is not None:
                yield key * parts + part, block, here
        if self.settings.keep_geometry:
            self.counts["pieces"] += len(cut.blocks) - cut.left
            self.counts["pieces_left_out"] += cut.left

    def _add_triangles(self, box: Box, buffer: PieceBuffer, low: Array) -> None:
        at = 0
        for corners, values in self._triangles(low):
            if self.settings.keep_geometry:
                buffer.add(corners)
            met = box.add(corners, values)
            self.met[at : at + len(corners)] |= met
            at += len(corners)

    def _triangles(self, low: Array) -> Iterator[tuple[Array, Array]]:
        """Corners relative to the box at `low`, and channels, batch by batch."""
        at = 0
        for segment in self.segments:
            large = segment["kind"] == LARGE
            count, width = int(segment["count"]), 36 if large else 6
            name = f"{SOURCE}/{int(segment['unit']):06}.cells"
            points = self._points(segment, name, low)
            triangles_at = int(segment["offset"]) + 8 * int(segment["vertices"])
            words_at, word_bytes = triangles_at + count * width, 12 * self.scene.words
            for first in range(0, count, BATCH_TRIANGLES):
                n = min(BATCH_TRIANGLES, count - first)
                data = self.scratch.read(name, triangles_at + first * width, n * width)
                corners = np.empty((n, 3, 3), np.int64)
                if large:
                    corners[:] = np.frombuffer(data, "<i4").reshape(n, 3, 3)
                    corners -= (self.low + low) << self.rules.snap_bits
                else:
                    gather(np.frombuffer(data, "<u2").reshape(n, 3), points, corners)
                    self._note_single(corners, low, at)
                extras = self.scratch.read(name, words_at + first * word_bytes, n * word_bytes)
                yield corners, _channels(np.frombuffer(extras, "<u4").reshape(n, 3, -1), self.scene)
                at += n

    def _points(self, segment: Array, name: str, low: Array) -> Array:
        """(v, 3) i8 vertices of a segment relative to the box at `low`, snap units."""
        k, count = self.rules.snap_bits, int(segment["vertices"])
        packed = np.frombuffer(self.scratch.read(name, int(segment["offset"]), 8 * count), "<u8")
        points = np.empty((count, 3), np.int64)
        unpack(packed, 1 << (k + self.scene.cell_bits - 1), low << k, points)
        return points

    def _note_single(self, corners: Array, low: Array, at: int) -> None:
        k, closed = self.rules.snap_bits, self.rules.closed
        within(corners, k, closed, low << k, self.room, self.single[at:])

    def _block(self, box: Box, part: int, parts: int, has_pieces: bool) -> Block | None:
        rows, codes = box.collect(part, parts, HIT)
        if not len(rows) and has_pieces:
            # Without an entry the surface would have a hole where a renderer draws its triangles.
            rows, codes = box.collect(part, parts)
            self.counts["area_pruned"] -= int(box.sums[rows, AREA].sum())
        if not len(rows):
            return None
        self.counts["voxels"] += len(rows)
        mask, normal, colour, weight = finish_voxels(
            rows, box.sums, box.flags, self.scene.colours, self.scene.normals,
            self.settings.normal_bits if self.scene.normal_column else 0, COLOUR_TABLES,
        )  # fmt: skip
        return Block(
            codes, mask, normal if self.scene.normal_column else None,
            colour if self.scene.colours else None, weight,
        )  # fmt: skip


@lru_cache(maxsize=1)
def _box(channels: int) -> Box:
    """The box of this process: with new arrays for each cell, adding up took 1.5 times as long."""
    return Box(channels)


def _channels(words: Array, scene: Scene) -> Array:
    """(n, 3, channels) f8 of the attribute words: linear R, G, B and alpha, then the normal."""
    values = np.empty((*words.shape[:2], scene.channels))
    at = 0
    if scene.colours:
        codes = np.ascontiguousarray(words[:, :, :1]).view(np.uint8)
        values[:, :, :3] = LINEAR_OF_CODE[codes[:, :, :3]]
        values[:, :, 3] = codes[:, :, 3]
        at = 4
    if scene.normals:
        components = np.ascontiguousarray(words[:, :, -2:]).view("<i2")[:, :, :3]
        values[:, :, at : at + 3] = components / 32767.0
    return values


def _segments(scratch: Scratch) -> Array:
    return np.asarray(np.load(scratch.path(f"{SOURCE}/{SEGMENTS}"), allow_pickle=False), SEGMENT)


def _scene(scratch: Scratch) -> Scene:
    return Scene.from_json(scratch.read(f"{SOURCE}/{SCENE}"))
