"""Checking a level against the one below: a parent block against what its children make.

Piece by piece, so that memory is that of the parent and one child, or of a few small ones. The
rules' ids and sentences are in gstream/check.py.
"""

from collections.abc import Iterator, Set
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.findings import ERROR, Finding
from gstream.read import BlockView

PIECE: Final = 1 << 20  # voxels, or up to 7 more; a block of 256^3 has 16 times as many
LOD_RULES: Final = {
    "mask": "GSB-0504",
    "normal": "GSB-0505",
    "colour": "GSB-0506",
    "weight": "GSB-0507",
}
PLACES: Final = "occupancy"
NO_PLACES: Final = np.empty(0, np.uint32)
ABSENT: Final[dict[str, NDArray[Any]]] = {
    PLACES: NO_PLACES,
    "mask": np.empty(0, np.uint8),
    "normal": np.empty((0, 2), np.uint16),
    "colour": np.empty((0, 4), np.uint8),
    "weight": np.empty(0, np.uint32),
}


class Family:
    """A parent block, compared with its children as they come, in the order of their keys."""

    def __init__(self, parent: BlockView, readable: Set[str]) -> None:
        """readable : columns of the parent that can be decoded, places among them."""
        self.parent = parent
        self.settings = parent.file.head.settings
        self.octant_shift = 3 * self.settings.block_log2
        self.pending: list[dict[str, NDArray[Any]]] = []  # columns of children, to be compared
        self.voxels = 0  # in them
        self.made = 0  # parents compared so far
        self.same_places = True
        self.wrong = dict.fromkeys(LOD_RULES, 0)  # voxels, by column
        try:
            self.held = self._columns(parent, readable) if parent.count else {PLACES: NO_PLACES}
        except (CorruptFileError, UnsupportedError):
            self.held = {}  # the parent's own group has reported it

    def _columns(self, block: BlockView, readable: Set[str]) -> dict[str, NDArray[Any]]:
        return {name: block.column(name) for name in (PLACES, *LOD_RULES) if name in readable}

    def add(self, child: BlockView, readable: Set[str]) -> None:
        """A child that has been checked alone; readable : its columns that can be decoded."""
        if not self.held:
            return
        columns = self._columns(child, readable)
        columns[PLACES] = columns[PLACES] | np.uint32((child.key & 7) << self.octant_shift)
        self.pending.append(columns)
        self.voxels += child.count
        if self.voxels >= PIECE:
            self._compare()

    def _compare(self) -> None:
        """Compare what the children make that have come since the last time."""
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
        reduce_runs = self.parent.file.arithmetic(len(codes)).reduce_runs
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

    def findings(self) -> Iterator[Finding]:
        """What differs, once all children have been added."""
        if not self.held:
            return
        if self.pending:
            self._compare()
        place = f"level {self.parent.level}, block {self.parent.key}"
        held = len(self.held[PLACES])
        if not self.same_places or held != self.made:
            said = f"{held} voxels are not the parents of the children's, {self.made}"
            yield Finding("GSB-0503", ERROR, place, said)
            return
        for name, wrong in self.wrong.items():
            if wrong:
                said = f"{name} of {wrong} voxels is not what the children make"
                yield Finding(LOD_RULES[name], ERROR, place, said)


def _whole_runs(codes: NDArray[np.uint32]) -> Iterator[slice]:
    """Pieces of ascending codes; none ends within the up to eight that have one parent."""
    begin = 0
    while begin < len(codes):
        last = codes[min(begin + PIECE, len(codes)) - 1]
        end = int(np.searchsorted(codes, last | np.uint32(7), side="right"))
        yield slice(begin, end)
        begin = end
