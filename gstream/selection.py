"""Voxels of one level of a block file, in pieces of bounded size: what exports go through.

Here: which voxels, in which order, and what their columns say in the world. Not here: file formats.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from gstream.blockview import BlockView
from gstream.errors import UsageError
from gstream.formats.columns import COLUMN_IDS
from gstream.formats.lodrule import unit_vectors
from gstream.read import EVERYWHERE, BlockFile

Progress = Callable[[int, int], None]  # blocks done, blocks in all
Array = NDArray[Any]

PIECE: Final = 1 << 18  # voxels: 2 MB a column of doubles, also of a block with 16 million


@dataclass(frozen=True, slots=True)
class Piece:
    """Some voxels of one block, in Morton order."""

    positions: NDArray[np.uint32]  # (n, 3) x, y, z within the level
    columns: dict[str, Array]  # (n,) or (n, components); normals as (n, 3) f32 in world axes


@dataclass(slots=True)
class Selection:
    """The voxels of a level that touch a box, or all of them."""

    file: BlockFile
    level: int
    first: NDArray[np.int64]  # (3,) voxels of the level, both inclusive
    last: NDArray[np.int64]
    whole: bool  # no box was given
    blocks: int = 0  # that have a voxel in the box, by their bounds
    voxels: int = 0

    @classmethod
    def of(cls, file: BlockFile, level: int, bounds: Sequence[float] | None) -> Self:
        """Select and count; only blocks at the border of the box are decoded.

        bounds : world box, low x y z and high x y z; None = everything
        errors : UsageError for a level or a box that is not there
        """
        if not 0 <= level < file.levels:
            raise UsageError(f"{file.path}: there is no level {level}", f"0 to {file.levels - 1}")
        size = -(-file.resolution // (1 << level))
        first, last = np.zeros(3, np.int64), np.full(3, size - 1, np.int64)
        if bounds is None:
            row = file.head.levels[level]
            return cls(file, level, first, last, True, int(row["blocks"]), int(row["voxels"]))
        low, high = file.index_box(bounds[:3], bounds[3:], level)
        if (high < first).any() or (low > last).any():
            raise UsageError(f"{file.path}: --bounds is outside the grid", "see gstream info: box")
        first = np.maximum(low, first).astype(np.int64)
        last = np.minimum(high, last).astype(np.int64)
        made = cls(file, level, first, last, False)
        for view in made.views(()):
            made.blocks += 1
            inside = (view.corner + view.low >= first) & (view.corner + view.high <= last)
            made.voxels += (
                view.count if inside.all() else sum(len(p.positions) for p in made._cut(view, ()))
            )
        return made

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Voxel index of the level -> world: (3, 4)."""
        return self.file.level_matrix(self.level)

    @property
    def attributes(self) -> tuple[str, ...]:
        """Stored columns that this release knows, without the occupancy."""
        return tuple(n for n, s in self.file.specs.items() if s.id > 1 and s.id in COLUMN_IDS)

    def pieces(
        self, names: Sequence[str], progress: Progress, done: int = 0, total: int | None = None
    ) -> Iterator[Piece]:
        """The voxels with the named columns, blocks in Morton order.

        done, total : blocks of this pass' beginning and of all passes, for `progress`
        """
        for view in self.views(("occupancy", *names)):
            yield from self._cut(view, names)
            done += 1
            progress(done, total or self.blocks)

    def views(self, names: Sequence[str]) -> Iterator[BlockView]:
        """The blocks whose bounds meet the box; names : columns that will be asked for."""
        box = EVERYWHERE if self.whole else (self.first.astype(float), self.last.astype(float))
        return self.file.blocks_inside(self.level, box, names)

    def _cut(self, view: BlockView, names: Sequence[str]) -> Iterator[Piece]:
        codes = view.column("occupancy")
        columns = {name: view.column(name) for name in names}
        for begin in range(0, len(codes), PIECE):
            part = slice(begin, begin + PIECE)
            decode_morton = self.file.arithmetic(len(codes[part])).decode_morton
            positions = decode_morton(codes[part]) + view.corner.astype(np.uint32)
            found = {name: values[part] for name, values in columns.items()}
            if not self.whole:
                inside = ((positions >= self.first) & (positions <= self.last)).all(axis=1)
                positions = positions[inside]
                found = {name: values[inside] for name, values in found.items()}
            if len(positions):
                if "normal" in found:
                    found["normal"] = self._in_world(found["normal"])
                yield Piece(positions, found)

    def _in_world(self, codes: NDArray[np.uint16]) -> NDArray[np.float32]:
        """Normals go by the inverse transpose; the matrix may be oblique."""
        decode_normals = self.file.arithmetic(len(codes)).decode_normals
        directions = decode_normals(codes, self.file.specs["normal"].bits)
        return unit_vectors(directions @ np.linalg.inv(self.file.matrix[:, :3]))
