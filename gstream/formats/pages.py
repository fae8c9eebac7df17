"""Reading the directory of a block file: pages on demand, each checked before anything trusts it.

Here: fetching, checking and searching pages. Not here: payloads. Layout: spec/blockfile.md,
section 5.
"""

from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError
from gstream.formats.blockhead import Head
from gstream.formats.directory import (
    PAGE_DTYPE,
    RECORD_BYTES,
    STATE_DATA,
    STATE_EMPTY,
    Rows,
    check_page_table,
    entry_dtype,
    stacked,
)
from gstream.formats.framing import (
    CODEC_CONSTANT,
    CODEC_LZ4,
    CODEC_RAW,
    MAX_RAW,
    crc32,
)
from gstream.formats.morton import decode_morton

ReadAt = Callable[[int, int], bytes]
CACHED_PAGES: Final = 16
NO_KEY: Final = np.uint64(2**64 - 1)


def rank(level: Any, key: Any) -> NDArray[np.uint64]:
    """A number that grows along the directory: levels from coarse to fine, then keys."""
    coarse = np.uint64(255) - np.asarray(level, np.uint64)
    return coarse << np.uint64(48) | np.asarray(key, np.uint64)


class Directory:
    """The pages of an open file, at most CACHED_PAGES of them in memory."""

    def __init__(
        self,
        head: Head,
        read_at: ReadAt,
        path: str,
        refuse_changed: Callable[[], None] = lambda: None,
    ) -> None:
        """refuse_changed : called where a CRC fails; raises if the file is another one by now."""
        self._head, self._read_at, self._path = head, read_at, path
        self._refuse_changed = refuse_changed
        self._dtype = entry_dtype(head.columns)
        self._tables: dict[int, Rows] = {} if head.depth == 2 else {0: head.page_table}
        self._pages: OrderedDict[int, Rows] = OrderedDict()
        first = [0, head.pages] if head.depth == 1 else [0, *np.cumsum(head.page_table["count"])]
        self._first_page = np.array(first, np.int64)  # of each table page

    @property
    def count(self) -> int:
        """Number of pages."""
        return self._head.pages

    def table(self, number: int) -> Rows:
        """Page records: of one table page, or at depth 1 all of them as table 0 (GSB-0207)."""
        if number not in self._tables:
            record = self._head.page_table[number]
            count, offset = int(record["count"]), int(record["offset"])
            data = self._checked(record, count * RECORD_BYTES, "GSB-0207", "table page")
            rows = np.frombuffer(data, PAGE_DTYPE)
            check_page_table(rows, None, self._head.body, self._path, offset)
            if rows[["level", "key"]][0] != record[["level", "key"]]:
                said = "the table page does not begin with the key that the head states"
                raise CorruptFileError("GSB-0207", self._path, offset, said)
            self._tables[number] = rows
        return self._tables[number]

    def record(self, page: int) -> Any:
        """The page record of one page."""
        table = int(np.searchsorted(self._first_page, page, side="right")) - 1
        return self.table(table)[page - self._first_page[table]]

    def page(self, number: int) -> Rows:
        """The entries of one page, checked alone (GSB-03..)."""
        if number in self._pages:
            self._pages.move_to_end(number)
            return self._pages[number]
        record = self.record(number)
        length = int(record["count"]) * self._dtype.itemsize
        data = self._checked(record, length, "GSB-0301", "page")
        rows = np.frombuffer(data, self._dtype)
        if rows[["level", "key"]][0] != record[["level", "key"]]:
            said = "the page does not begin with the key that its page record states"
            raise CorruptFileError("GSB-0302", self._path, int(record["offset"]), said)
        check_entries(rows, self._head, self._path, int(record["offset"]))
        self._pages[number] = rows
        if len(self._pages) > CACHED_PAGES:
            self._pages.popitem(last=False)
        return rows

    def _checked(self, record: Any, length: int, rule: str, what: str) -> bytes:
        offset = int(record["offset"])
        if int(record["length"]) != length:
            said = f"a {what} of {record['count']} rows has {record['length']} bytes, not {length}"
            raise CorruptFileError(rule, self._path, offset, said)
        data = self._read_at(offset, length)
        if crc32(data) != record["crc"]:
            self._refuse_changed()
            raise CorruptFileError(rule, self._path, offset, f"the {what} does not match its CRC")
        return data

    def pages_of(self, level: int) -> range:
        """The pages that hold entries of one level."""
        if not self._head.levels["blocks"][level]:
            return range(0)
        return range(self._page_at(rank(level, 0)), self._page_at(rank(level, 2**48 - 1)) + 1)

    def entries_of(self, level: int) -> Iterator[Rows]:
        """The entries of one level, page by page, in order, just those that the level above lists.

        errors : CorruptFileError GSB-0303, 0306, 0307; for what is missing, at the end
        """
        found, last = 0, -1
        for number in self.pages_of(level):
            page = self.page(number)
            entries = page[page["level"] == level]
            if not len(entries):
                continue  # the page ends where the level begins
            at = int(self.record(number)["offset"])
            if entries["key"][0] <= last:
                raise CorruptFileError("GSB-0303", self._path, at, "a page repeats earlier keys")
            if level + 1 < self._head.settings.levels:
                self._check_parents(level, entries["key"], at)
            found, last = found + len(entries), int(entries["key"][-1])
            yield entries
        if level + 1 < self._head.settings.levels:
            listed = sum(self._children(number, level + 1) for number in self.pages_of(level + 1))
            if listed != found:
                said = f"level {level} has {found} blocks, not the {listed} of the child masks"
                raise CorruptFileError("GSB-0306", self._path, self._head.head_bytes, said)

    def _children(self, number: int, level: int) -> int:
        """How many blocks the child masks of a page's entries of one level list."""
        page = self.page(number)
        return int(np.bitwise_count(page["children"][page["level"] == level]).sum(dtype=np.int64))

    def _check_parents(self, level: int, keys: NDArray[np.uint64], at: int) -> None:
        """Refuse blocks of a page without a parent, or with one that does not list them."""
        wanted = keys >> np.uint64(3)
        parents = self.between(level + 1, int(wanted[0]), int(wanted[-1]))
        rows = np.searchsorted(parents["key"], wanted)
        there = np.append(parents["key"], NO_KEY)[rows] == wanted
        masks = np.append(parents["children"], np.uint8(0))[rows].astype(np.uint64)
        listed = masks >> (keys & np.uint64(7)) & np.uint64(1) != 0
        for rule, good, said in (
            ("GSB-0307", there, "has no parent"),
            ("GSB-0306", listed, "is not in the child mask of its parent"),
        ):
            if not good.all():
                block = f"block {keys[good.argmin()]} of level {level}"
                raise CorruptFileError(rule, self._path, at, f"{block} {said}")

    def between(self, level: int, first: int, last: int) -> Rows:
        """The entries of one level with keys from first to last, both inclusive."""
        parts = [np.empty(0, self._dtype)]
        if self._head.levels["blocks"][level] and first <= last:
            low, high = rank(level, first), rank(level, last)
            for number in range(self._page_at(low), self._page_at(high) + 1):
                page = self.page(number)
                ranks = rank(page["level"], page["key"])
                parts.append(page[(ranks >= low) & (ranks <= high)])
        return np.concatenate(parts)

    def siblings(self, level: int, key: int) -> Rows:
        """The entries of a block that is there and of its siblings: they are on its page."""
        page = self.page(self._page_at(rank(level, key)))
        alike: Rows = page[(page["level"] == level) & (page["key"] >> np.uint64(3) == key >> 3)]
        return alike

    def find(self, level: int, key: int) -> Any | None:
        """The entry of one block, or None; at most one table page and one page are read."""
        wanted = rank(level, key)
        if not self._head.pages or wanted < _first_rank(self._head.page_table):
            return None
        page = self.page(self._page_at(wanted))
        ranks = rank(page["level"], page["key"])
        row = int(np.searchsorted(ranks, wanted))
        return page[row] if row < len(page) and ranks[row] == wanted else None

    def _page_at(self, wanted: NDArray[np.uint64]) -> int:
        """The last page that begins at or before `wanted`; page 0 when none does."""
        table = 0
        if self._head.depth == 2:
            table = _last_at_or_before(self._head.page_table, wanted)
        return int(self._first_page[table]) + _last_at_or_before(self.table(table), wanted)


def _first_rank(records: Rows) -> NDArray[np.uint64]:
    return rank(records["level"][0], records["key"][0])


def _last_at_or_before(records: Rows, wanted: NDArray[np.uint64]) -> int:
    ranks = rank(records["level"], records["key"])
    return max(0, int(np.searchsorted(ranks, wanted, side="right")) - 1)


def check_entries(rows: Rows, head: Head, path: str, at: int) -> None:
    """Refuse a page with an entry that breaks a rule on its own or stands out of order."""

    def refuse(rule: str, bad: NDArray[np.bool_], said: str) -> None:
        if bad.any():
            row = int(bad.argmax())
            what = f"block {rows['key'][row]} of level {rows['level'][row]} {said}"
            raise CorruptFileError(rule, path, at + row * rows.itemsize, what)

    ranks = rank(rows["level"], rows["key"])
    refuse("GSB-0303", np.append(False, ranks[1:] <= ranks[:-1]), "is out of order or twice there")
    data = rows["state"] == STATE_DATA
    level = np.minimum(rows["level"], head.settings.levels - 1)
    edge = 1 << head.settings.block_log2
    wide = blocks_per_axis(head, level)[:, None]
    inside = (rows["key"] >> np.uint64(48) == 0) & (decode_morton(rows["key"]) < wide).all(axis=1)
    refuse("GSB-0305", (rows["level"] != level) | ~inside, "is outside the grid")
    bounds = (rows["low"] > rows["high"]).any(axis=1) | (rows["high"] >= edge).any(axis=1)
    refuse("GSB-0305", bounds | (rows["state"] > STATE_DATA), "has an impossible state or bounds")
    count = (rows["count"] > edge**3) | (data & (rows["count"] == 0))
    refuse("GSB-0409", count, "has no voxels, or more than its volume")
    childless = rows["children"] == 0
    refuse("GSB-0305", (rows["level"] == 0) & ~childless, "has children at level 0")
    refuse("GSB-0306", (rows["level"] != 0) & childless, "has no children above level 0")
    spare = rows["zero"].any(axis=1) | (rows["flags"] != 0)
    spare |= stacked(rows, head.columns, "zero").any(axis=(1, 2))
    refuse("GSB-0309", spare, "has reserved bytes that are not zero")
    empty = rows["state"] == STATE_EMPTY
    filled = rows["low"].any(axis=1) | rows["high"].any(axis=1) | (rows["count"] != 0)
    for field in ("offset", "stored", "raw", "crc", "constant", "codec", "filter"):
        filled |= stacked(rows, head.columns, field).any(axis=1)
    refuse("GSB-0308", empty & filled, "is empty and yet has voxels, bounds or columns")
    for column in head.columns:
        bad = ~empty & _impossible(rows[column.field], head.body)
        refuse("GSB-0311", bad, f"has an impossible record of column {column.name}")


def blocks_per_axis(head: Head, level: NDArray[Any]) -> NDArray[np.int64]:
    """Blocks along an axis at each of the given levels."""
    shift = level.astype(np.int64) + head.settings.block_log2
    return -(-head.settings.resolution // (np.int64(1) << shift))


def _impossible(record: Rows, body: tuple[int, int]) -> NDArray[np.bool_]:
    """Column records that no writer makes, whatever the stored bytes are; unknown codecs pass."""
    stored, raw = record["stored"].astype(np.int64), record["raw"].astype(np.int64)
    codec, offset = record["codec"], record["offset"]
    constant = codec == CODEC_CONSTANT
    bad = (raw < 1) | (raw > MAX_RAW) | ((stored == 0) & ((offset != 0) | (record["crc"] != 0)))
    bad |= constant & (stored != 0)
    compressed = (codec == CODEC_RAW) | (codec == CODEC_LZ4)
    bad |= compressed & ((stored == 0) | (record["constant"] != 0))
    first, last = np.uint64(body[0]), np.uint64(body[1])
    outside = (offset < first) | (offset > last) | (record["stored"] > last - offset)
    impossible: NDArray[np.bool_] = bad | ((stored != 0) & outside)
    return impossible
