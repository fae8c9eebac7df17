"""Checking the content of a block file: every CRC, column, voxel and level, and the content id.

Many blocks at once; where something is wrong with one of them, or they are too large for that, one
after the other. Memory: a few pages of the directory, a block and its parent.
"""

from collections.abc import Callable, Iterator, Mapping, Set, Sized
from hashlib import blake2b
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gstream.blockview import BlockView
from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.batches import Batch, cut
from gstream.formats.blockfile import CONTENT_ID_BYTES, canonical_settings, identity_rows
from gstream.formats.columns import COLUMN_IDS, hash64, raw_form
from gstream.formats.directory import STATE_DATA, Rows, group_starts
from gstream.formats.findings import ERROR, NOTE, Finding, broken
from gstream.formats.morton import decode_morton
from gstream.formats.pieces import PIECE_IDS, TRIANGLE, VERTEX, Pieces, hash_of
from gstream.levelcheck import Columns, Comparison, Family, level_columns
from gstream.piececheck import piece_findings
from gstream.read import BlockFile

Progress = Callable[[int, int], None]  # blocks checked, blocks in all
Batches = Mapping[str, Batch]  # columns by name

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
        self.voxel_specs = {n: s for n, s in file.specs.items() if s.id not in PIECE_IDS}
        self.piece_names = [n for n, s in file.specs.items() if s.id in PIECE_IDS]
        self.pieces = 0  # source triangles
        weighed = head.settings.lod_weighting == "area"
        self.attributes = not weighed or "weight" in file.specs  # of levels can be checked

    def findings(self, progress: Progress | None) -> Iterator[Finding]:
        done = 0
        for number in range(self.file.directory.count):
            for entries in _pieces(self.file.directory.page(number)):
                if not self._add_sound(entries):
                    for first, last in pairwise(group_starts(entries).tolist()):
                        for finding in self._group(entries[first:last]):
                            self.damaged |= finding.severity == ERROR
                            yield finding
                done += len(entries)
                if progress:
                    progress(done, self.file.head.blocks)
        yield from self._piece_totals()
        for name in sorted(self.unreadable):
            said = "this release does not know its kind, codec or filter: only its CRC was checked"
            yield Finding("GSB-0412", NOTE, f"column {name}", said)
        if not self.attributes and self.file.levels > 1:
            said = "level attributes: not checkable, the weights they were made with are not stored"
            yield Finding("GSB-0508", NOTE, "levels", said)
        same = self.identity.digest() == self.file.head.content_id
        if not (same or self.damaged or self.unreadable):
            yield Finding("GSB-0509", ERROR, "byte 40", "the content id is not that of the content")

    def _add_sound(self, entries: Rows) -> bool:
        """Check whole groups of a level at once; False, and nothing done, if not all is well."""
        if self.unreadable:
            return False
        level, file = int(entries["level"][0]), self.file
        rows = entries[entries["state"] == STATE_DATA]
        batches = file.decode(rows, self.voxel_specs)
        if not (_are_sound(batches, self.voxel_specs) and self._are_places(rows, batches)):
            return False
        if any(self._meaningless({name: batch.values for name, batch in batches.items()})):
            return False
        if level + 1 < file.levels:
            first, last = int(entries["key"][0]) >> 3, int(entries["key"][-1]) >> 3
            above = file.directory.between(level + 1, first, last)
            if not self._make(rows, batches, above[above["state"] == STATE_DATA]):
                return False
        columns = [list(batch.hashes()) for batch in batches.values()]
        of_data = np.zeros((len(rows), len(file.specs)), np.uint64)
        of_data[:, : len(batches)] = np.array(columns, np.uint64).T
        pieces = self.pieces
        for row, of_block in zip(rows, of_data, strict=True) if self.piece_names else ():
            if any(self._block_pieces(BlockView(file, row), of_block)) or self.unreadable:
                self.pieces = pieces
                return False
        hashes = np.zeros((len(entries), len(file.specs)), np.uint64)
        hashes[entries["state"] == STATE_DATA] = of_data
        self.identity.update(identity_rows(entries, hashes))
        return True

    def _are_places(self, rows: Rows, batches: Batches) -> bool:
        """Whether the bounds of some blocks are those of their voxels, within the level."""
        codes, counts = batches["occupancy"].values, rows["count"].astype(np.int64)
        bounds = self.file.arithmetic(0).bounds_of_each(codes, counts)
        tight = (bounds[:, 0] == rows["low"]).all() and (bounds[:, 1] == rows["high"]).all()
        last = decode_morton(rows["key"]) * self.file.block_edge + rows["high"]
        return bool(tight and (last < self._width(int(rows["level"][0]))).all())

    def _make(self, rows: Rows, batches: Batches, parents: Rows) -> bool:
        """Whether the parents of some blocks are what these make."""
        held = self.file.decode(parents, batches)
        if not _are_sound(held, batches):
            return False
        log2_edge = self.file.head.settings.block_log2
        comparison = Comparison(self.file, level_columns(parents, held, log2_edge))
        comparison.add(level_columns(rows, batches, log2_edge))
        return not any(comparison.findings(""))

    def _width(self, level: int) -> int:
        """Voxels per axis of a level."""
        return -(-self.file.resolution // (1 << level))

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

    def _block_pieces(self, view: BlockView, hashes: NDArray[np.uint64]) -> Iterator[Finding]:
        """The source triangles of a block; their columns' hashes go into `hashes`."""
        columns = {}
        for name in self.piece_names:
            try:
                columns[name] = view.column(name)
            except CorruptFileError as error:
                yield broken(error)
                return
            except UnsupportedError:
                self.unreadable.add(name)
                continue
            hashes[list(self.file.specs).index(name)] = hash_of(columns[name])
        self.pieces += len(columns.get(TRIANGLE, ()))
        if len(columns) == len(PIECE_IDS):
            yield from piece_findings(view, Pieces(columns[VERTEX], columns[TRIANGLE]))

    def _piece_totals(self) -> Iterator[Finding]:
        """What all blocks together must say of source triangles."""
        if len(self.piece_names) == 1:
            yield Finding("GSB-0414", ERROR, "column table", "it has one of two columns")
        stated = self.file.metadata["ledger"].get("pieces", self.pieces)
        known = not self.damaged and TRIANGLE not in self.unreadable
        if TRIANGLE in self.piece_names and known and stated != self.pieces:
            said = f"pieces {stated} are not the {self.pieces} that are stored"
            yield Finding("GSB-0604", ERROR, "ledger", said)

    def _block(self, view: BlockView, hashes: NDArray[np.uint64]) -> Iterator[Finding]:
        """One block alone; its columns' hashes go into `hashes`."""
        for i, (name, spec) in enumerate(self.file.specs.items()):
            if spec.id in PIECE_IDS:
                continue
            try:
                if spec.id not in COLUMN_IDS:
                    view.stored(name)
                    self.unreadable.add(name)
                    continue
                raw = view.octree() if name == "occupancy" else raw_form(view.column(name))
            except CorruptFileError as error:
                yield broken(error)
                return
            except UnsupportedError:
                self.unreadable.add(name)
                continue
            hashes[i] = hash64(raw.data)
        if "occupancy" not in self.unreadable:
            yield from self._places(view)
        yield from self._values(view)
        if self.piece_names:
            yield from self._block_pieces(view, hashes)

    def _places(self, view: BlockView) -> Iterator[Finding]:
        place = f"level {view.level}, block {view.key}"
        codes = view.column("occupancy")
        bounds = self.file.arithmetic(view.count).bounds_of_each(codes, np.array([view.count]))
        low, high = map(tuple, bounds[0].tolist())
        if low != tuple(view.low) or high != tuple(view.high):
            said = f"the bounds {view.low}-{view.high} are not the voxels' {low}-{high}"
            yield Finding("GSB-0501", ERROR, place, said)
        width = self._width(view.level)
        edge = self.file.block_edge
        if any(at * edge + last >= width for at, last in zip(view.place, high, strict=True)):
            said = f"a voxel is outside the {width} voxels per axis of its level"
            yield Finding("GSB-0502", ERROR, place, said)

    def _values(self, view: BlockView) -> Iterator[Finding]:
        names = [name for name in ("mask", "normal", "weight") if name in self._readable]
        for name in self._meaningless({name: view.column(name) for name in names}):
            place = f"level {view.level}, block {view.key}"
            yield Finding("GSB-0410", ERROR, place, f"column {name} has a value without meaning")

    def _meaningless(self, columns: Columns) -> Iterator[str]:
        """Which columns have a value that stands for nothing."""
        if "mask" in columns and (columns["mask"] - np.uint8(1) > 62).any():  # 0 - 1 is 255
            yield "mask"
        if "normal" in columns:
            bits, codes = self.file.specs["normal"].bits, columns["normal"]
            lawful = self.file.arithmetic(len(codes)).all_canonical
            cuts = range(0, len(codes), PIECE)
            if not all(lawful(codes[at : at + PIECE], bits) for at in cuts):
                yield "normal"
        if "weight" in columns and not columns["weight"].all():
            yield "weight"


def _are_sound(batches: Batches, wanted: Sized) -> bool:
    return len(batches) == len(wanted) and all(batch.sound.all() for batch in batches.values())


def _pieces(entries: Rows) -> Iterator[Rows]:
    """Whole groups of one level, with as many voxels as are decoded at once."""
    for level in np.unique(entries["level"])[::-1]:
        rows = entries[entries["level"] == level]
        groups = group_starts(rows)
        sizes = np.add.reduceat(rows["count"], groups[:-1], dtype=np.int64)
        for first, last in pairwise(groups[cut(sizes)].tolist()):
            yield rows[first:last]
