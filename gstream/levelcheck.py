"""Checking a level against the one below: parent blocks against what their children make.

Piece by piece, so that memory is that of the parent and one child, or of a few small ones. The
rules' ids and sentences are in gstream/check.py.
"""

from collections.abc import Iterator, Mapping, Set
from contextlib import suppress
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.blockview import BlockView
from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.batches import Batch
from gstream.formats.directory import Rows
from gstream.formats.findings import ERROR, Finding
from gstream.read import BlockFile

Columns = dict[str, NDArray[Any]]  # by name; PLACES are codes

PIECE: Final = 1 << 20  # voxels that are waited for; a block of 256^3 has 16 times as many
MERGED: Final = 1 << 14  # voxels, or up to 7 more, that are merged at once: in a cache of 1 MB
LOD_RULES: Final = {
    "mask": "GSB-0504",
    "normal": "GSB-0505",
    "colour": "GSB-0506",
    "weight": "GSB-0507",
}
PLACES: Final = "occupancy"
NO_PLACES: Final = np.empty(0, np.uint32)
ABSENT: Final[Columns] = {
    PLACES: NO_PLACES,
    "mask": np.empty(0, np.uint8),
    "normal": np.empty((0, 2), np.uint16),
    "colour": np.empty((0, 4), np.uint8),
    "weight": np.empty(0, np.uint32),
}


class Comparison:
    """Voxels of a level, compared with those of the finer one as they come, in Morton order."""

    def __init__(self, file: BlockFile, held: Columns) -> None:
        """held : columns of the voxels, PLACES among them."""
        self.file, self.settings, self.held = file, file.head.settings, held
        self.pending: list[Columns] = []  # of finer voxels, to be compared
        self.voxels = 0  # in them
        self.made = 0  # parents compared so far
        self.same_places = True
        self.wrong = dict.fromkeys(LOD_RULES, 0)  # voxels, by column

    def add(self, columns: Columns) -> None:
        """Finer voxels; the codes of PLACES >> 3 are those of the voxels that they make."""
        self.pending.append(columns)
        self.voxels += len(columns[PLACES])
        if self.voxels >= PIECE:
            self._compare()

    def _compare(self) -> None:
        """Compare what the voxels make that have come since the last time."""
        columns = dict(ABSENT)
        for name in columns:
            parts = [block[name] for block in self.pending if name in block]
            if parts and len(parts) == len(self.pending):
                columns[name] = parts[0] if len(parts) == 1 else np.concatenate(parts)
        codes = columns.pop(PLACES)
        compared = [name for name, values in columns.items() if len(values) and name in self.held]
        weighed = self.settings.lod_weighting == "area"
        if weighed and not len(columns["weight"]):
            compared = [name for name in compared if name == "mask"]
        if not len(columns["mask"]):
            columns["mask"] = np.full(len(codes), 63, np.uint8)
        reduce_runs = self.file.arithmetic(len(codes)).reduce_runs
        for piece in _whole_runs(codes):
            mask, normal, colour, weight = (values[piece] for values in columns.values())
            made = reduce_runs(
                codes[piece], mask, normal, colour, weight, self.settings.normal_bits, weighed
            )
            here = slice(self.made, self.made + len(made.morton))
            self.made = here.stop
            self.same_places &= np.array_equal(made.morton, self.held[PLACES][here])
            for name in compared if self.same_places else ():
                wrong = getattr(made, name) != self.held[name][here]
                if wrong.any():
                    self.wrong[name] += int(wrong.reshape(len(wrong), -1).any(axis=1).sum())
        self.pending, self.voxels = [], 0

    def findings(self, place: str) -> Iterator[Finding]:
        """What differs, once all finer voxels have been added."""
        if self.pending:
            self._compare()
        held = len(self.held[PLACES])
        if not self.same_places or held != self.made:
            said = f"{held} voxels are not the parents of the children's, {self.made}"
            yield Finding("GSB-0503", ERROR, place, said)
            return
        for name, wrong in self.wrong.items():
            if wrong:
                said = f"{name} of {wrong} voxels is not what the children make"
                yield Finding(LOD_RULES[name], ERROR, place, said)


class Family:
    """A parent block, compared with its children as they come, in the order of their keys."""

    def __init__(self, parent: BlockView, readable: Set[str]) -> None:
        """readable : columns of the parent that can be decoded, places among them."""
        self.parent = parent
        self.octant_shift = 3 * parent.file.head.settings.block_log2
        self.comparison: Comparison | None = None
        # What cannot be decoded, the parent's own group has reported.
        with suppress(CorruptFileError, UnsupportedError):
            held = _columns(parent, readable) if parent.count else {PLACES: NO_PLACES}
            self.comparison = Comparison(parent.file, held)

    def add(self, child: BlockView, readable: Set[str]) -> None:
        """A child that has been checked alone; readable : its columns that can be decoded."""
        if self.comparison:
            columns = _columns(child, readable)
            columns[PLACES] = columns[PLACES] | np.uint32((child.key & 7) << self.octant_shift)
            self.comparison.add(columns)

    def findings(self) -> Iterator[Finding]:
        """What differs, once all children have been added."""
        if self.comparison:
            place = f"level {self.parent.level}, block {self.parent.key}"
            yield from self.comparison.findings(place)


def _columns(block: BlockView, readable: Set[str]) -> Columns:
    return {name: block.column(name) for name in (PLACES, *LOD_RULES) if name in readable}


def level_columns(rows: Rows, batches: Mapping[str, Batch], log2_edge: int) -> Columns:
    """What Comparison takes of several blocks, with codes of their places in the level."""
    columns = {name: batches[name].values for name in (PLACES, *LOD_RULES) if name in batches}
    corners = rows["key"] << np.uint64(3 * log2_edge)
    columns[PLACES] = columns[PLACES] | np.repeat(corners, rows["count"])
    return columns


def _whole_runs(codes: NDArray[Any]) -> Iterator[slice]:
    """Pieces of ascending codes; none ends within the up to eight that have one parent."""
    begin = 0
    while begin < len(codes):
        last = codes[min(begin + MERGED, len(codes)) - 1]
        end = int(np.searchsorted(codes, last | codes.dtype.type(7), side="right"))
        yield slice(begin, end)
        begin = end
