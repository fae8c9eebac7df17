"""Checking the content of a block file: every CRC, column, voxel and level, and the content id.

Memory: a few pages of the directory, and the nine blocks of one sibling group and its parent.
"""

from collections.abc import Callable, Iterator
from hashlib import blake2b
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.blockfile import CONTENT_ID_BYTES, canonical_settings, identity_rows
from gstream.formats.columns import COLUMN_IDS, hash64, raw_column
from gstream.formats.directory import STATE_DATA, Rows, group_starts
from gstream.formats.filters import encode_occupancy
from gstream.formats.findings import ERROR, NOTE, Finding
from gstream.formats.lodrule import Reduced, canonical_normals, reduce_runs
from gstream.formats.morton import decode_morton
from gstream.read import BlockFile, BlockView

Progress = Callable[[int, int], None]  # blocks checked, blocks in all

PIECE: Final = 1 << 20  # voxels; a block of 256^3 has 16 times as many, and 64-bit copies of none
LOD_RULES: Final = (
    ("GSB-0504", "mask"),
    ("GSB-0505", "normal"),
    ("GSB-0506", "colour"),
    ("GSB-0507", "weight"),
)


def _pieces(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """The rows of an array, at most PIECE at once."""
    return (values[at : at + PIECE] for at in range(0, len(values), PIECE))


def broken(error: CorruptFileError) -> Finding:
    """The finding of an error that reading met."""
    return Finding(error.rule, ERROR, f"byte {error.at}", error.said)


class Content:
    """The second half of a full check: CRCs, columns, voxels, levels of detail, content id."""

    def __init__(self, file: BlockFile) -> None:
        self.file = file
        head = file.head
        settings = canonical_settings(head.settings.pack(), head.columns)
        self.identity = blake2b(settings, digest_size=CONTENT_ID_BYTES)
        self.unreadable: set[str] = set()  # columns of an unknown kind, codec or filter
        self.damaged = False
        self.weighed = head.settings.lod_weighting == "area"
        self.attributes = not self.weighed or "weight" in file.specs

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
        views = [BlockView(self.file, entry) for entry in entries]
        sound = True
        for view, row in zip(views, hashes, strict=True):
            if view.entry["state"] == STATE_DATA:
                for finding in self._block(view, row):
                    sound = False
                    yield finding
        self.identity.update(identity_rows(entries, hashes))
        if sound and views[0].level + 1 < self.file.levels:
            yield from self._parent(views)

    def _block(self, view: BlockView, hashes: NDArray[np.uint64]) -> Iterator[Finding]:
        """One block alone; its columns' hashes go into `hashes`."""
        for i, (name, spec) in enumerate(self.file.specs.items()):
            try:
                view.stored(name)
                if spec.id not in COLUMN_IDS:
                    self.unreadable.add(name)
                    continue
                values = view.column(name)
            except CorruptFileError as error:
                yield broken(error)
                return
            except UnsupportedError:
                self.unreadable.add(name)
                continue
            if name == "occupancy":
                values = encode_occupancy(values, self.file.head.settings.block_log2)
            hashes[i] = hash64(raw_column(values.reshape(len(values), -1)))
        if "occupancy" not in self.unreadable:
            yield from self._places(view)
        yield from self._values(view)

    def _readable(self, name: str) -> bool:
        return name in self.file.specs and name not in self.unreadable

    def _places(self, view: BlockView) -> Iterator[Finding]:
        place = f"level {view.level}, block {view.key}"
        pieces = map(decode_morton, _pieces(view.column("occupancy")))
        bounds = np.array([(piece.min(axis=0), piece.max(axis=0)) for piece in pieces])
        low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
        if (low != view.low).any() or (high != view.high).any():
            said = f"the bounds {view.low}-{view.high} are not the voxels' {low}-{high}"
            yield Finding("GSB-0501", ERROR, place, said)
        width = -(-self.file.resolution // (1 << view.level))
        if (view.corner + high >= width).any():
            said = f"a voxel is outside the {width} voxels per axis of its level"
            yield Finding("GSB-0502", ERROR, place, said)

    def _values(self, view: BlockView) -> Iterator[Finding]:
        wrong: dict[str, bool] = {}
        if self._readable("mask"):
            wrong["mask"] = bool(((view.mask == 0) | (view.mask > 63)).any())
        if self._readable("normal"):
            bits = self.file.specs["normal"].bits
            pieces = _pieces(view.normal_codes)
            wrong["normal"] = not all(canonical_normals(piece, bits).all() for piece in pieces)
        if self._readable("weight"):
            wrong["weight"] = bool((view.weight == 0).any())
        for name, bad in wrong.items():
            if bad:
                place = f"level {view.level}, block {view.key}"
                yield Finding(
                    "GSB-0410", ERROR, place, f"column {name} has a value without meaning"
                )

    def _parent(self, views: list[BlockView]) -> Iterator[Finding]:
        """Compare the parent with what the LOD rule makes of its children."""
        if not self._readable("occupancy"):
            return
        entry = self.file.directory.find(views[0].level + 1, views[0].key >> 3)
        parent = BlockView(self.file, entry)
        children = [view for view in views if view.count]
        place = f"level {parent.level}, block {parent.key}"
        try:
            made = self._reduced(children)
            stored = self._columns([parent] if parent.count else [], octant=False)
        except (CorruptFileError, UnsupportedError):
            return  # the parent's own group has reported it
        if not np.array_equal(stored[0], made.morton):
            said = (
                f"{len(stored[0])} voxels are not the parents of the children's, {len(made.morton)}"
            )
            yield Finding("GSB-0503", ERROR, place, said)
            return
        for (rule, name), found in zip(LOD_RULES, stored[1:], strict=True):
            wanted: NDArray[Any] = getattr(made, name)
            if not self._readable(name) or (name != "mask" and not self.attributes):
                continue
            if not np.array_equal(wanted, found):
                wrong = int((wanted != found).reshape(len(wanted), -1).any(axis=1).sum())
                said = f"{name} of {wrong} voxels is not what the children make"
                yield Finding(rule, ERROR, place, said)

    def _columns(self, views: list[BlockView], octant: bool) -> tuple[NDArray[Any], ...]:
        """(codes, mask, normal, colour, weight); absent columns have length 0.

        octant : codes begin with the block's place among its siblings
        """
        shift = 3 * self.file.head.settings.block_log2
        codes = [
            view.column("occupancy") | np.uint32((view.key & 7) << shift if octant else 0)
            for view in views
        ]
        empty = {"mask": ((0,), "u1"), "normal": ((0, 2), "u2"), "colour": ((0, 4), "u1")}
        columns: list[NDArray[Any]] = [np.concatenate([np.empty(0, np.uint32), *codes])]
        for name in ("mask", "normal", "colour", "weight"):
            shape, kind = empty.get(name, ((0,), "u4"))
            there = views if self._readable(name) else []
            parts = [np.empty(shape, kind), *(view.column(name) for view in there)]
            columns.append(np.concatenate(parts))
        return tuple(columns)

    def _reduced(self, children: list[BlockView]) -> Reduced:
        """What the LOD rule makes of sibling blocks."""
        codes, mask, normal, colour, weight = self._columns(children, octant=True)
        if not self._readable("mask"):
            mask = np.full(len(codes), 63, np.uint8)
        bits = self.file.head.settings.normal_bits
        return reduce_runs(codes, mask, normal, colour, weight, bits, self.weighed)
