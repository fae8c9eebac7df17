"""Checking the content of a block file: every CRC, column, voxel and level, and the content id.

Memory: a few pages of the directory, a block and its parent.
"""

from collections.abc import Callable, Iterator, Set
from hashlib import blake2b
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.blockfile import CONTENT_ID_BYTES, canonical_settings, identity_rows
from gstream.formats.columns import COLUMN_IDS, hash64, raw_column
from gstream.formats.directory import STATE_DATA, Rows, group_starts
from gstream.formats.findings import ERROR, NOTE, Finding, broken
from gstream.levelcheck import Family
from gstream.read import BlockFile, BlockView

Progress = Callable[[int, int], None]  # blocks checked, blocks in all

PIECE: Final = 1 << 20  # voxels; a block of 256^3 has 16 times as many


class Content:
    """The second half of a full check: CRCs, columns, voxels, levels of detail, content id."""

    def __init__(self, file: BlockFile) -> None:
        self.file = file
        head = file.head
        settings = canonical_settings(head.settings.pack(), head.columns)
        self.identity = blake2b(settings, digest_size=CONTENT_ID_BYTES)
        self.unreadable: set[str] = set()  # columns of an unknown kind, codec or filter
        self.damaged = False
        weighed = head.settings.lod_weighting == "area"
        self.attributes = not weighed or "weight" in file.specs  # of levels can be checked

    def findings(self, progress: Progress | None) -> Iterator[Finding]:
        done = 0
        for number in range(self.file.directory.count):
            entries = self.file.directory.page(number)
            for first, last in pairwise(group_starts(entries).tolist()):
                for finding in self._group(entries[first:last]):
                    self.damaged |= finding.severity == ERROR
                    yield finding
                done += last - first
                if progress:
                    progress(done, self.file.head.blocks)
        for name in sorted(self.unreadable):
            said = "this release does not know its kind, codec or filter: only its CRC was checked"
            yield Finding("GSB-0412", NOTE, f"column {name}", said)
        if not self.attributes and self.file.levels > 1:
            said = "level attributes: not checkable, the weights they were made with are not stored"
            yield Finding("GSB-0508", NOTE, "levels", said)
        same = self.identity.digest() == self.file.head.content_id
        if not (same or self.damaged or self.unreadable):
            yield Finding("GSB-0509", ERROR, "byte 40", "the content id is not that of the content")

    def _group(self, entries: Rows) -> Iterator[Finding]:
        """One group of siblings, and the parent that they make."""
        hashes = np.zeros((len(entries), len(self.file.specs)), np.uint64)
        family = self._family(int(entries["level"][0]) + 1, int(entries["key"][0]) >> 3)
        for entry, row in zip(entries, hashes, strict=True):
            if entry["state"] != STATE_DATA:
                continue
            view = BlockView(self.file, entry)
            for finding in self._block(view, row):
                family = None  # what is missing here would be wrong there
                yield finding
            if "occupancy" in self.unreadable:
                family = None
            if family:
                family.add(view, self._readable)
        self.identity.update(identity_rows(entries, hashes))
        if family:
            yield from family.findings()

    def _family(self, level: int, key: int) -> Family | None:
        """The parent at that place; None above the last level, and where places are unknown."""
        if level == self.file.levels or "occupancy" not in self._readable:
            return None
        entry = self.file.directory.find(level, key)
        return Family(BlockView(self.file, entry), self._readable)

    @property
    def _readable(self) -> Set[str]:
        return self.file.specs.keys() - self.unreadable

    def _block(self, view: BlockView, hashes: NDArray[np.uint64]) -> Iterator[Finding]:
        """One block alone; its columns' hashes go into `hashes`."""
        for i, (name, spec) in enumerate(self.file.specs.items()):
            try:
                if spec.id not in COLUMN_IDS:
                    view.stored(name)
                    self.unreadable.add(name)
                    continue
                raw = view.octree().data if name == "occupancy" else raw_column(view.column(name))
            except CorruptFileError as error:
                yield broken(error)
                return
            except UnsupportedError:
                self.unreadable.add(name)
                continue
            hashes[i] = hash64(raw)
        if "occupancy" not in self.unreadable:
            yield from self._places(view)
        yield from self._values(view)

    def _places(self, view: BlockView) -> Iterator[Finding]:
        place = f"level {view.level}, block {view.key}"
        codes = view.column("occupancy")
        low, high = self.file.arithmetic(view.count).tight_bounds(codes)
        if list(low) != view.low.tolist() or list(high) != view.high.tolist():
            said = f"the bounds {view.low}-{view.high} are not the voxels' {low}-{high}"
            yield Finding("GSB-0501", ERROR, place, said)
        width = -(-self.file.resolution // (1 << view.level))
        edge = self.file.block_edge
        if any(at * edge + last >= width for at, last in zip(view.place, high, strict=True)):
            said = f"a voxel is outside the {width} voxels per axis of its level"
            yield Finding("GSB-0502", ERROR, place, said)

    def _values(self, view: BlockView) -> Iterator[Finding]:
        wrong: dict[str, bool] = {}
        if "mask" in self._readable:
            wrong["mask"] = bool((view.mask - np.uint8(1) > 62).any())  # 0 - 1 is 255
        if "normal" in self._readable:
            bits, codes = self.file.specs["normal"].bits, view.normal_codes
            lawful = self.file.arithmetic(view.count).all_canonical
            cuts = range(0, view.count, PIECE)
            wrong["normal"] = not all(lawful(codes[at : at + PIECE], bits) for at in cuts)
        if "weight" in self._readable:
            wrong["weight"] = not view.weight.all()
        for name, bad in wrong.items():
            if bad:
                place = f"level {view.level}, block {view.key}"
                yield Finding(
                    "GSB-0410", ERROR, place, f"column {name} has a value without meaning"
                )
