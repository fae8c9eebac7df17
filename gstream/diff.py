"""`gstream diff`: do two block files hold the same voxels, and if not, where and how much?

Content is compared, not bytes: blocks may have other sizes, columns other filters. Cell by cell in
Morton order, a cell being as large as the larger block, so memory is that of a few blocks. Source
triangles are not compared: where blocks have other sizes they are cut in other places.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from heapq import merge
from itertools import groupby
from operator import itemgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.blockview import BlockView
from gstream.compiled import compiled
from gstream.formats.lodrule import decode_normals
from gstream.formats.morton import decode_morton
from gstream.formats.pieces import PIECE_IDS
from gstream.read import BlockFile, open_block_file

Progress = Callable[[int, int], None]  # blocks done, blocks in all
Codes = NDArray[np.uint64]
Array = NDArray[Any]

DIFFERENT: Final = 7  # exit code: not 1, as of diff(1), because here 1 is an error of ours
SHAPE: Final = ("block_edge", "levels")
MADE_WITH: Final = ("sep", "ties", "faces", "normals", "lod_weighting", "snap_bits", "box")
METADATA: Final = ("units", "up", "crs")
UNITS: Final = {  # of the largest difference; labels are names and have none
    "normal": "degrees",
    "mask": "faces",
    "colour": "codes",
    "weight": "voxel faces",
    "spread": "codes",
}


@dataclass(slots=True)
class ColumnDifference:
    """How the values of one column differ, over the voxels that both files have."""

    differing: int = 0  # voxels
    largest: float = 0.0  # UNITS; 0 where there is no measure

    def add(self, differing: int, largest: float) -> None:
        self.differing += differing
        self.largest = max(self.largest, largest)


@dataclass(slots=True)
class LevelDifference:
    """What differs in one level."""

    level: int
    voxels: list[int] = field(default_factory=lambda: [0, 0])  # of A, of B
    only: list[int] = field(default_factory=lambda: [0, 0])  # in A alone, in B alone
    columns: dict[str, ColumnDifference] = field(default_factory=dict)
    low: NDArray[np.int64] | None = None  # (3,) voxels of the level around all differences
    high: NDArray[np.int64] | None = None  # inclusive

    @property
    def equal(self) -> bool:
        return not any(self.only) and not any(c.differing for c in self.columns.values())

    def locate(self, codes: Codes) -> None:
        """Let the box hold the voxels of these Morton codes."""
        if len(codes):
            places = decode_morton(codes).astype(np.int64)
            low, high = places.min(axis=0), places.max(axis=0)
            self.low = low if self.low is None else np.minimum(self.low, low)
            self.high = high if self.high is None else np.maximum(self.high, high)


@dataclass(slots=True)
class Difference:
    """What differs between two files."""

    paths: tuple[str, str]
    matrices: tuple[NDArray[np.float64], NDArray[np.float64]]
    made_with: dict[str, tuple[Any, Any]]  # settings and metadata that differ: no difference
    columns: tuple[tuple[str, ...], tuple[str, ...]]  # only in A, only in B
    compared: tuple[str, ...]  # columns that both have, beside the occupancy
    levels: list[LevelDifference] = field(default_factory=list)

    @property
    def same_grid(self) -> bool:
        """Equal indices are equal places; else no voxel was compared."""
        return np.array_equal(*self.matrices)

    @property
    def equal(self) -> bool:
        columns = self.columns == ((), ())
        return self.same_grid and columns and all(level.equal for level in self.levels)

    def box(self, level: LevelDifference) -> list[float] | None:
        """The world box of a level's differences: low x y z, high x y z."""
        if level.low is None or level.high is None:
            return None
        ends = np.stack((level.low, level.high + 1)) * 2.0**level.level
        choice = np.indices((2, 2, 2)).reshape(3, 8)
        corners = np.stack([ends[choice[axis], axis] for axis in range(3)], axis=1)
        matrix = self.matrices[0]
        placed = corners @ matrix[:, :3].T + matrix[:, 3]
        return [*placed.min(axis=0).tolist(), *placed.max(axis=0).tolist()]

    def as_dict(self) -> dict[str, Any]:
        """The difference as JSON has it."""
        return {
            "a": self.paths[0],
            "b": self.paths[1],
            "equal": self.equal,
            "same_grid": self.same_grid,
            "made_with": {name: list(pair) for name, pair in self.made_with.items()},
            "columns_only_a": list(self.columns[0]),
            "columns_only_b": list(self.columns[1]),
            "levels": [self._level_as_dict(level) for level in self.levels],
        }

    def _level_as_dict(self, level: LevelDifference) -> dict[str, Any]:
        return {
            "level": level.level,
            "equal": level.equal,
            "voxels_a": level.voxels[0],
            "voxels_b": level.voxels[1],
            "only_a": level.only[0],
            "only_b": level.only[1],
            "columns": {
                name: {"differing": c.differing, "largest": c.largest, "unit": UNITS.get(name)}
                for name, c in level.columns.items()
            },
            "box_voxels": None
            if level.low is None or level.high is None
            else [*level.low.tolist(), *level.high.tolist()],
            "box": self.box(level),
        }


def diff(a: str, b: str, progress: Progress = lambda done, total: None) -> Difference:
    """Compare two block files, paths or URLs.

    progress : called with (done, all), in blocks
    errors : those of reading; UnsupportedError where an unknown column is not stored alike
    """
    with open_block_file(a, choose=compiled) as left, open_block_file(b, choose=compiled) as right:
        found = _heads(left, right)
        if found.same_grid:
            step = _Steps(progress, left.head.blocks + right.head.blocks)
            for level in range(_levels(left, right)):
                found.levels.append(_level(left, right, level, found.compared, step))
        return found


@dataclass(slots=True)
class _Steps:
    progress: Progress
    total: int
    done: int = 0

    def __call__(self, blocks: int) -> None:
        self.done += blocks
        self.progress(self.done, self.total)


def _levels(a: BlockFile, b: BlockFile) -> int:
    """Levels to compare: a file that ends in a single block has all that it can have."""
    shorter = min(a, b, key=lambda file: file.levels)
    complete = shorter.resolution <= shorter.block_edge << (shorter.levels - 1)
    return shorter.levels if complete else max(a.levels, b.levels)


def _heads(a: BlockFile, b: BlockFile) -> Difference:
    pairs = {name: (getattr(a, name), getattr(b, name)) for name in SHAPE}
    pairs |= {name: (getattr(a.header, name), getattr(b.header, name)) for name in MADE_WITH}
    pairs |= {name: (a.metadata.get(name), b.metadata.get(name)) for name in METADATA}
    names = [tuple(name for name in file.columns if name != "occupancy") for file in (a, b)]
    voxels = [name for name in names[0] if a.specs[name].id not in PIECE_IDS]
    return Difference(
        paths=(a.path, b.path),
        matrices=(a.matrix, b.matrix),
        made_with={name: pair for name, pair in pairs.items() if pair[0] != pair[1]},
        columns=(
            tuple(name for name in names[0] if name not in names[1]),
            tuple(name for name in names[1] if name not in names[0]),
        ),
        compared=tuple(name for name in voxels if name in names[1]),
    )


def _level(
    a: BlockFile, b: BlockFile, level: int, names: tuple[str, ...], step: Callable[[int], None]
) -> LevelDifference:
    found = LevelDifference(level, columns={name: ColumnDifference() for name in names})
    log2 = max(a.head.settings.block_log2, b.head.settings.block_log2)
    cells = merge(_cells(a, 0, level, log2), _cells(b, 1, level, log2), key=itemgetter(0))
    for _, parts in groupby(cells, key=itemgetter(0)):
        sides: list[list[BlockView]] = [[], []]
        for _, side, views in parts:
            sides[side] = views
        _cell(sides[0], sides[1], found)
        step(len(sides[0]) + len(sides[1]))
    return found


def _cells(
    file: BlockFile, side: int, level: int, log2: int
) -> Iterator[tuple[int, int, list[BlockView]]]:
    """(key, side, blocks) of each cube of 2^log2 voxels, in Morton order."""
    if level < file.levels:
        shift = 3 * (log2 - file.head.settings.block_log2)
        for key, views in groupby(file.blocks(level), lambda view: view.key >> shift):
            yield key, side, list(views)


def _cell(a: list[BlockView], b: list[BlockView], found: LevelDifference) -> None:
    """Compare one cell; blocks that are stored alike are not decoded."""
    for side, views in enumerate((a, b)):
        found.voxels[side] += sum(view.count for view in views)
    names = [name for name in found.columns if not _stored_alike(a, b, name)]
    alike = _stored_alike(a, b, "occupancy")
    if alike and not names:
        return
    codes = _codes(a)
    others = codes if alike else _codes(b)
    rows: tuple[Any, Any] = (slice(None), slice(None))
    if not alike and not np.array_equal(codes, others):
        rows = (
            np.isin(codes, others, assume_unique=True),
            np.isin(others, codes, assume_unique=True),
        )
        for side, (all_codes, common) in enumerate(zip((codes, others), rows, strict=True)):
            found.only[side] += int((~common).sum())
            found.locate(all_codes[~common])
        names = list(found.columns)  # stored alike for other voxels means nothing
    if not a or not b:
        return
    for name in names:
        values = [_values(views, name)[row] for views, row in zip((a, b), rows, strict=True)]
        wrong, largest = _compare(name, *values)
        found.columns[name].add(int(wrong.sum()), largest)
        found.locate(codes[rows[0]][wrong])


def _is_in(codes: Codes, others: Codes) -> NDArray[np.bool_]:
    return np.isin(codes, others, assume_unique=True)


def _stored_alike(a: list[BlockView], b: list[BlockView], name: str) -> bool:
    return [v.key for v in a] == [v.key for v in b] and all(
        _recipe(x, name) == _recipe(y, name) and x.stored(name) == y.stored(name)
        for x, y in zip(a, b, strict=True)
    )


def _recipe(view: BlockView, name: str) -> tuple[int, ...]:
    """All that says what the stored bytes mean."""
    spec, record = view.file.specs[name], view.entry[name]
    settings = (view.file.head.settings.block_log2, spec.id, spec.components, spec.bits, view.count)
    return *settings, *(int(record[part]) for part in ("raw", "constant", "codec", "filter"))


def _codes(views: list[BlockView]) -> Codes:
    """Morton codes within the level, ascending."""
    parts = [
        view.column("occupancy").astype(np.uint64)
        | np.uint64(view.key << 3 * view.file.head.settings.block_log2)
        for view in views
    ]
    return np.concatenate([np.empty(0, np.uint64), *parts])


def _values(views: list[BlockView], name: str) -> Array:
    """One column of some blocks; normals as directions, whatever their bits."""
    values = np.concatenate([view.column(name) for view in views])
    if name == "normal":
        return decode_normals(values, views[0].file.specs[name].bits)
    return values


def _compare(name: str, a: Array, b: Array) -> tuple[NDArray[np.bool_], float]:
    """Which voxels differ, and the largest difference in UNITS."""
    wrong: NDArray[np.bool_] = (a != b) if a.ndim == 1 else (a != b).any(axis=1)
    if not wrong.any() or name not in UNITS:
        return wrong, 0.0
    x, y = a[wrong].astype(np.int64), b[wrong].astype(np.int64)
    if name == "normal":
        return wrong, _angle(x.astype(float), y.astype(float))
    if name == "mask":
        return wrong, float(np.bitwise_count(x ^ y).max())
    return wrong, float(np.abs(x - y).max()) / (1 << 20 if name == "weight" else 1)


def _angle(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """The largest angle in degrees; 180 between a direction and none."""
    cross = np.linalg.norm(np.cross(x, y), axis=1)
    angle = np.degrees(np.arctan2(cross, (x * y).sum(axis=1)))
    none = ~x.any(axis=1) | ~y.any(axis=1)
    return float(np.where(none, 180.0, angle).max())
