"""Simplify: the levels above the finest, each from the stored values of the one below.

Constant memory: eight sibling blocks and their parent at a time (thesis 3.3.2). A unit makes the
lower levels of a run of subtrees; the few levels above those are made serially at the end. By the
LOD rule of the spec a block file's level depends only on stored values, so `check` and any other
writer reach the same bytes.
"""

import json
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.formats.cells import SCENE, Scene
from gstream.formats.columns import Block, ColumnSpec, decode_column, encode_block
from gstream.formats.directory import Rows, pile_dtype
from gstream.formats.lodrule import COLOUR_TABLES
from gstream.formats.pile import PileWriter, read_pile_rows
from gstream.formats.rows import (
    Record,
    block_range,
    names_json,
    pipeline_columns,
    rows_from_bytes,
    tight_bounds,
)
from gstream.job import Job, Summary, Unit
from gstream.kernels import filters as fast
from gstream.kernels.lod import reduce_runs
from gstream.run.publish import Scratch

NAME = "6-simplify"
SOURCE = "5-merge"
ROWS, PILES, LEVEL_ROWS = "level-0.rows", "piles.json", "levels.rows"
SUBTREE_LEVELS = 3  # a unit's subtrees have up to 8^3 finest blocks
UNIT_BLOCKS = 1024

Array = NDArray[Any]


def plan(job: Job) -> list[Unit]:
    """Runs of whole subtrees, up to UNIT_BLOCKS finest blocks unless one subtree has more."""
    with Scratch(job) as scratch:
        scene = Scene.from_json(scratch.read(f"{SOURCE}/{SCENE}"))
        depth = _subtree_levels(job, scene)
        if depth == 0:
            return []
        keys = _rows(scratch, f"{SOURCE}/{ROWS}", _columns(job, scene))["key"]
    roots = keys >> np.uint64(3 * depth)
    starts = np.flatnonzero(np.append(True, roots[1:] != roots[:-1]))
    units: list[Unit] = []
    first = 0
    for end in [*map(int, starts[1:]), len(keys)]:
        if end - first >= UNIT_BLOCKS or end == len(keys):
            data = (first, end)
            units.append(Unit(NAME, f"{len(units):06}", float(end - first), 0, first, data))
            first = end
    return units


def work(job: Job, unit: Unit) -> None:
    """Make the lower levels of a run of subtrees."""
    first, last = unit.data
    name = f"{NAME}/{unit.name}.gsp"
    with Scratch(job) as scratch:
        scene = Scene.from_json(scratch.read(f"{SOURCE}/{SCENE}"))
        columns, depth = _columns(job, scene), _subtree_levels(job, scene)
        row_bytes = pile_dtype(columns).itemsize
        data = scratch.read(f"{SOURCE}/{ROWS}", first * row_bytes, (last - first) * row_bytes)
        rows = rows_from_bytes(data, columns)
        piles = json.loads(scratch.read(f"{SOURCE}/{PILES}"))
        with scratch.write(name) as file, PileWriter(file, columns) as pile:
            tree = Tree(job, scene, scratch, piles, pile)
            for part in _groups(rows, depth):
                tree.make(part, depth, base=0)
        scratch.mark_done(unit, {"blocks": tree.blocks, "voxels": tree.voxels}, (name,))


def finish(job: Job) -> Summary:
    """Make the levels above the subtrees, one after another, and publish the rows of all levels."""
    units, counts = plan(job), {"blocks": 0, "voxels": 0}
    with Scratch(job) as scratch:
        scene = Scene.from_json(scratch.read(f"{SOURCE}/{SCENE}"))
        columns, depth = _columns(job, scene), _subtree_levels(job, scene)
        names = [f"{NAME}/{unit.name}.gsp" for unit in units]
        for done in scratch.finished(units):
            counts = {key: counts[key] + done[key] for key in counts}
        parts = [_pile_rows(scratch, name, number) for number, name in enumerate(names)]
        rows = np.concatenate([*parts, np.empty(0, pile_dtype(columns))])
        top = _levels(job, scene) - 1
        if top > depth:
            roots = np.sort(rows[rows["level"] == depth], order="key")
            name = f"{NAME}/top.gsp"
            with scratch.write(name) as file, PileWriter(file, columns) as pile:
                tree = Tree(job, scene, scratch, names, pile)
                tree.make(roots, top, base=depth)
            counts = {
                "blocks": counts["blocks"] + tree.blocks,
                "voxels": counts["voxels"] + tree.voxels,
            }
            rows = np.concatenate([rows, _pile_rows(scratch, name, len(names))])
            names.append(name)
        with scratch.write(f"{NAME}/{LEVEL_ROWS}") as file:
            file.write(rows.tobytes())
        with scratch.write(f"{NAME}/{PILES}") as file:
            file.write(names_json(names))
    return Summary(NAME, {**counts, "levels": top + 1})


def warm() -> None:
    """Compile the kernels of this stage."""
    fast.warm()
    one, none = np.zeros(1, np.uint32), np.empty((0, 4), np.uint8)
    for colour in (none, np.zeros((1, 4), np.uint8)):
        reduce_runs(
            one, np.ones(1, np.uint8), np.zeros((1, 2), np.uint16), colour, one + one.dtype.type(1),
            11, True, COLOUR_TABLES,
        )  # fmt: skip


class Tree:
    """Depth first through one subtree: children before parents, eight blocks a level in memory."""

    def __init__(
        self, job: Job, scene: Scene, scratch: Scratch, piles: Sequence[str], pile: PileWriter
    ) -> None:
        self.settings, self.scene, self.scratch = job.voxelizing, scene, scratch
        self.piles, self.pile = piles, pile
        self.columns = _columns(job, scene)
        self.names = tuple(column.name for column in self.columns)
        self.log2_edge = self.settings.block.bit_length() - 1
        self.blocks = self.voxels = 0

    def make(self, rows: Rows, level: int, base: int) -> Block:
        """The block at `level` above `rows`: sorted blocks of level `base` under one key."""
        if level == base:
            return self._read(rows[0])
        octants, blocks = [], []
        for part in _groups(rows, level - 1 - base):
            octants.append(int(part["key"][0]) >> 3 * (level - 1 - base) & 7)
            blocks.append(self.make(part, level - 1, base))
        parent = self._reduce(octants, blocks)
        key = int(rows["key"][0]) >> 3 * (level - base)
        self._write(key, level, parent, sum(1 << octant for octant in octants))
        return parent

    def _read(self, row: np.void) -> Block:
        offset, length = block_range(row, self.columns)
        name = self.piles[int(row["pile"])]
        data = memoryview(self.scratch.read(name, offset, length))
        arrays = {}
        for column in self.columns:
            stored = row[column.name]
            record = Record(
                int(stored["codec"]),
                int(stored["filter"]),
                int(stored["constant"]),
                int(stored["raw"]),
            )
            at = int(stored["offset"]) - offset if stored["stored"] else 0
            arrays[column.name] = decode_column(
                column, record, data[at : at + int(stored["stored"])], int(row["count"]),
                self.log2_edge, filters=fast, path=name, at=int(stored["offset"]),
            )  # fmt: skip
        return Block(
            arrays["occupancy"], arrays["mask"], arrays["normal"],
            arrays.get("colour"), arrays.get("weight"),
        )  # fmt: skip

    def _reduce(self, octants: Sequence[int], blocks: Sequence[Block]) -> Block:
        shift = np.uint32(3 * self.log2_edge)
        codes = np.concatenate(
            [b.morton | np.uint32(o) << shift for o, b in zip(octants, blocks, strict=True)]
        )
        none = {"colour": np.empty((0, 4), np.uint8), "weight": np.empty(0, np.uint32)}
        whole = {
            name: np.concatenate([getattr(b, name) for b in blocks])
            if name in self.names
            else none[name]
            for name in ("mask", "normal", "colour", "weight")
        }
        morton, mask, normal, colour, weight = reduce_runs(
            codes, whole["mask"], whole["normal"], whole["colour"], whole["weight"],
            self.settings.normal_bits, self.scene.weighted, COLOUR_TABLES,
        )  # fmt: skip
        return Block(
            morton, mask, normal,
            colour if self.scene.colours else None, weight if self.scene.weighted else None,
        )  # fmt: skip

    def _write(self, key: int, level: int, block: Block, children: int) -> None:
        stored = frozenset() if self.settings.keep_weights else frozenset({"weight"})
        encoded = encode_block(
            block, self.log2_edge, self.names, self.settings.normal_bits, self.settings.lz4,
            filters=fast, stored=stored,
        )  # fmt: skip
        low, high = tight_bounds(block.morton)
        self.pile.add(key, level, block.count, low, high, children, encoded)
        self.blocks += 1
        self.voxels += block.count


def _groups(rows: Rows, levels: int) -> Iterator[Rows]:
    """Runs of rows under one key, `levels` above their own."""
    roots = rows["key"] >> np.uint64(3 * levels)
    starts = np.flatnonzero(np.append(True, roots[1:] != roots[:-1]))
    for first, last in zip(starts, [*starts[1:], len(rows)], strict=True):
        yield rows[first:last]


def _levels(job: Job, scene: Scene) -> int:
    return scene.grid.level_count(job.voxelizing.block) if job.voxelizing.lod else 1


def _subtree_levels(job: Job, scene: Scene) -> int:
    return min(SUBTREE_LEVELS, _levels(job, scene) - 1)


def _columns(job: Job, scene: Scene) -> tuple[ColumnSpec, ...]:
    return pipeline_columns(scene.colours, job.voxelizing.normal_bits, scene.weighted)


def _rows(scratch: Scratch, name: str, columns: Sequence[ColumnSpec]) -> Rows:
    return rows_from_bytes(scratch.read(name), columns)


def _pile_rows(scratch: Scratch, name: str, number: int) -> Rows:
    rows = read_pile_rows(partial(scratch.read, name), scratch.size(name), name)
    rows["pile"] = number
    return rows
