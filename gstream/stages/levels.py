"""Levels: finished blocks to a pile, and the blocks above them from those in memory.

No stage of its own: voxelize makes the levels inside a cell with it, simplify those above. A level
depends only on stored values of the one below (spec, "Levels of detail"), so that whoever makes it
reaches the same bytes. The eight voxels that become one lie in one block: each block is reduced as
it comes, and one unfinished parent a level is all that takes memory.
"""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from gstream.formats.cells import Scene
from gstream.formats.columns import (
    COLUMN_IDS,
    Block,
    ColumnSpec,
    EncodedColumn,
    encode_block,
)
from gstream.formats.filters import NONE
from gstream.formats.framing import CODEC_RAW
from gstream.formats.lodrule import COLOUR_TABLES
from gstream.formats.pieces import NO_PIECES, Pieces, encode_pieces
from gstream.formats.pile import PileWriter
from gstream.formats.rows import pipeline_columns
from gstream.job import VoxelizeSettings
from gstream.kernels import filters as fast
from gstream.kernels.lod import reduce_runs
from gstream.kernels.morton import tight_bounds

NO_NORMAL: Final = np.empty((0, 2), np.uint16)
NO_COLOUR: Final = np.empty((0, 4), np.uint8)
NO_WEIGHT: Final = np.empty(0, np.uint32)
NOT_STORED: Final = EncodedColumn(b"", 0, 0, 0, CODEC_RAW, NONE, 0)


def coarsest_level(settings: VoxelizeSettings, scene: Scene) -> int:
    """The number of the last level of the file."""
    return scene.grid.level_count(settings.block) - 1 if settings.lod else 0


def job_columns(settings: VoxelizeSettings, scene: Scene) -> tuple[ColumnSpec, ...]:
    """The columns that this job's piles carry."""
    bits = vertex_bits(settings, scene) if settings.keep_geometry else 0
    return pipeline_columns(scene.columns, settings.normal_bits, bits)


def vertex_bits(settings: VoxelizeSettings, scene: Scene) -> int:
    """Bits of a coordinate of a source triangle in a block, borders included."""
    return settings.block.bit_length() + scene.grid.snap_bits


@dataclass(slots=True)
class Parent:
    """A block of which not all children have come."""

    key: int = -1
    children: int = 0  # bit c: octant c has come
    parts: list[Block] = field(default_factory=list)  # one for each octant that has come


class LevelPile:
    """Takes blocks in Morton order, and writes them and all levels above them up to `top`."""

    def __init__(
        self, pile: PileWriter, settings: VoxelizeSettings, scene: Scene, top: int
    ) -> None:
        self.pile, self.settings, self.scene, self.top = pile, settings, scene, top
        self.log2_edge = settings.block.bit_length() - 1
        self.vertex_bits = vertex_bits(settings, scene)
        columns = job_columns(settings, scene)
        self.names = tuple(c.name for c in columns if c.id in COLUMN_IDS)
        self.parents = [Parent() for _ in range(top + 1)]
        self.blocks = self.voxels = 0  # written

    def write(
        self,
        key: int,
        level: int,
        block: Block,
        children: int = 0,
        pieces: Pieces = NO_PIECES,
    ) -> None:
        """Write a block, then climb; pieces : its source triangles, where these are kept."""
        encoded = {"weight": NOT_STORED} | encode_block(
            block, self.log2_edge, self._wanted(level), self.settings.normal_bits,
            self.settings.lz4, filters=fast,
            stored=frozenset() if self.settings.keep_weights else frozenset({"weight"}),
        )  # fmt: skip
        if self.settings.keep_geometry:
            encoded |= encode_pieces(pieces, self.vertex_bits, self.settings.lz4, filters=fast)
        low, high = tight_bounds(block.morton)
        self.pile.add(key, level, block.count, low, high, children, encoded)
        self.blocks += 1
        self.voxels += block.count
        self.climb(key, level, block)

    def climb(self, key: int, level: int, block: Block) -> None:
        """Reduce a block, which is stored already, into its parent."""
        if level == self.top:
            return
        if self.parents[level + 1].key != key >> 3:
            self._write_parent(level + 1)
            self.parents[level + 1].key = key >> 3
        parent = self.parents[level + 1]
        parent.parts.append(self._reduced(block, key & 7))
        parent.children |= 1 << (key & 7)

    def close(self) -> None:
        """Write the parents whose last child has come: no more blocks will."""
        for level in range(1, self.top + 1):
            self._write_parent(level)

    def _wanted(self, level: int) -> tuple[str, ...]:
        """The weights of a block whose parent is made here go nowhere but into a file with them."""
        settings = self.settings
        last = coarsest_level(settings, self.scene)
        kept = settings.keep_weights or not settings.lod or level == self.top != last
        return tuple(name for name in self.names if name != "weight" or kept)

    def _write_parent(self, level: int) -> None:
        parent, self.parents[level] = self.parents[level], Parent()
        if parent.parts:
            self.write(parent.key, level, _joined(parent.parts), parent.children)

    def _reduced(self, block: Block, octant: int) -> Block:
        morton, mask, normal, colour, weight = reduce_runs(
            block.morton, block.mask,
            NO_NORMAL if block.normal is None else block.normal,
            NO_COLOUR if block.colour is None else block.colour,
            NO_WEIGHT if block.weight is None else block.weight,
            self.settings.normal_bits, self.scene.weighted, COLOUR_TABLES,
        )  # fmt: skip
        morton |= np.uint32(octant << 3 * (self.log2_edge - 1))
        return Block(
            morton, mask, None if block.normal is None else normal,
            None if block.colour is None else colour, None if block.weight is None else weight,
        )  # fmt: skip


def warm() -> None:
    """Compile the kernels of this module."""
    fast.warm()
    one, mask, normal = np.ones(1, np.uint32), np.ones(1, np.uint8), np.zeros((1, 2), np.uint16)
    reduce_runs(one, mask, normal, NO_COLOUR, one, 11, True, COLOUR_TABLES)
    tight_bounds(one)


def _joined(parts: list[Block]) -> Block:
    """One block of its octants."""

    def column(name: str) -> Any:
        arrays = [getattr(part, name) for part in parts]
        return None if arrays[0] is None else np.concatenate(arrays)

    return Block(*map(column, ("morton", "mask", "normal", "colour", "weight")))
