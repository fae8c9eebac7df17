"""The directory: pages on demand, each checked before use, and all that were read kept.

Spec: sections 4 (PAGE) and 5.
"""

from collections.abc import Callable
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from .errors import CorruptFileError
from .head import Column, Head, need

Rows = NDArray[np.void]
MAX_ROWS = 1024  # of a page or table page
MAX_RECORDS = 1400  # of PAGE
MAX_RAW = 64 << 20
RAW, LZ4, CONSTANT = range(3)  # codecs
PAGE_RECORD = np.dtype(
    [("level", "u1"), ("zero", "u1", 3), ("count", "<u4"), ("key", "<u8"), ("offset", "<u8"),
     ("length", "<u4"), ("crc", "<u4")]
)  # fmt: skip
COLUMN_RECORD = np.dtype(
    [("offset", "<u8"), ("stored", "<u4"), ("raw", "<u4"), ("crc", "<u4"), ("constant", "<u4"),
     ("codec", "u1"), ("filter", "u1"), ("zero", "u1", 6)]
)  # fmt: skip
ENTRY: list[Any] = [
    ("key", "<u8"), ("count", "<u4"), ("level", "u1"), ("state", "u1"), ("children", "u1"),
    ("flags", "u1"), ("low", "u1", 3), ("high", "u1", 3), ("zero", "u1", 2),
]  # fmt: skip


class Table(NamedTuple):
    """Page records, and a number of each that ascends with the directory."""

    rows: Rows
    orders: NDArray[np.uint64]


def entry_dtype(columns: tuple[Column, ...]) -> np.dtype[np.void]:
    """An entry, with a nested record per column."""
    return np.dtype([*ENTRY, *((column.field, COLUMN_RECORD) for column in columns)])


def orders(rows: Rows) -> NDArray[np.uint64]:
    """(n,) u64: ascends from coarse to fine levels, within a level by key."""
    found: NDArray[np.uint64] = (255 - rows["level"].astype(np.uint64)) << 48 | rows["key"]
    return found


def block_places(keys: NDArray[np.uint64]) -> NDArray[np.int64]:
    """(n, 3) block coordinates x, y, z of keys below 2^48."""
    places = np.empty((len(keys), 3), np.int64)
    for axis in range(3):
        bits = keys >> np.uint64(axis) & np.uint64(0x249249249249)
        for shift, mask in (
            (2, 0x0C30C30C30C3), (4, 0x00F00F00F00F), (8, 0x0000FF0000FF), (16, 0xFFFF),
        ):  # fmt: skip
            bits = (bits | bits >> np.uint64(shift)) & np.uint64(mask)
        places[:, axis] = bits
    return places


class Directory:
    """Pages of one file; `read` gives exactly the bytes asked for."""

    def __init__(self, head: Head, read: Callable[[int, int], bytes]) -> None:
        self.head, self.read = head, read
        self.dtype = entry_dtype(head.columns)
        self._pages: dict[int, Rows] = {}
        need(
            len(head.page_table) in range(0, 32 * MAX_RECORDS + 1, 32), "GSB-0206", "no page table"
        )
        top = self._checked_records(np.frombuffer(head.page_table, PAGE_RECORD), "page table")
        counts = top.rows["count"].astype(np.int64)
        rows = len(counts) if head.depth == 1 else int(counts.sum())
        need(rows == head.pages, "GSB-0206", f"{rows} pages, not {head.pages}", "page table")
        if head.depth == 1:
            total = int(counts.sum())
            need(total == head.blocks, "GSB-0206", f"{total} entries in all", "page table")
            counts = np.array([rows])
        self._top = top
        self._first_page = np.cumsum(counts) - counts  # of each table
        self._tables = {0: top} if head.depth == 1 else {}

    def page_of(self, level: int, key: int) -> int:
        """The last page that begins at or before a block, 0 when none does.

        At depth 2 this may read a table page.
        """
        order = np.uint64((255 - int(level)) << 48 | int(key))
        table = 0 if self.head.depth == 1 else _last_at(self._top, order)
        return int(self._first_page[table]) + _last_at(self._table(table), order)

    def is_loaded(self, page: int) -> bool:
        """Whether the page is in memory."""
        return page in self._pages

    def page(self, page: int) -> Rows:
        """The entries of a page, each checked on its own; read-only.

        errors : IndexError when there is no such page
        """
        if page not in self._pages:
            if not 0 <= page < self.head.pages:
                raise IndexError(f"page {page} of {self.head.pages}")
            table = int(np.searchsorted(self._first_page, page, "right")) - 1
            record = self._table(table).rows[page - self._first_page[table]]
            rows = self._fetch(record, self.dtype, "GSB-0301", f"page {page}")
            first = rows[["level", "key"]][0] == record[["level", "key"]]
            need(bool(first), "GSB-0302", "begins with another block", f"page {page}")
            self._check_entries(rows)
            self._pages[page] = rows
        return self._pages[page]

    def _table(self, table: int) -> Table:
        if table not in self._tables:
            record, where = self._top.rows[table], f"table page {table}"
            rows = self._fetch(record, PAGE_RECORD, "GSB-0207", where)
            first = rows[["level", "key"]][0] == record[["level", "key"]]
            need(bool(first), "GSB-0207", "begins with another block", where)
            self._tables[table] = self._checked_records(rows, where)
        return self._tables[table]

    def _fetch(self, record: np.void, dtype: np.dtype[np.void], rule: str, where: str) -> Rows:
        count, length = int(record["count"]), int(record["length"])
        need(length == count * dtype.itemsize, rule, f"{count} rows in {length} bytes", where)
        data = self.read(int(record["offset"]), length)
        need(crc32(data) == record["crc"], rule, "does not match its CRC", where)
        return np.frombuffer(data, dtype)

    def _checked_records(self, rows: Rows, where: str) -> Table:
        begin, end = self.head.head_bytes, self.head.body_end
        offset, length = rows["offset"], rows["length"]
        inside = (offset >= begin) & (offset <= end) & (length <= end - offset)
        lawful = inside & (rows["count"] >= 1) & (rows["count"] <= MAX_ROWS)
        lawful &= ~rows["zero"].any(axis=1)
        need(bool(lawful.all()), "GSB-0206", "a page has no rows, or is not in the body", where)
        ascending = orders(rows)
        need(bool((ascending[1:] > ascending[:-1]).all()), "GSB-0303", "is out of order", where)
        return Table(rows, ascending)

    def _check_entries(self, rows: Rows) -> None:
        """Refuse what is impossible whatever the other pages and the payloads are."""
        head, edge = self.head, 1 << self.head.block_log2
        key, level, state, count = (rows[n] for n in ("key", "level", "state", "count"))

        def each(lawful: NDArray[np.bool_], rule: str, said: str) -> None:
            if not lawful.all():
                row = int(np.argmin(lawful))
                raise CorruptFileError(rule, said, f"block {key[row]} of level {level[row]}")

        ascending = orders(rows)
        each(np.append(True, ascending[1:] > ascending[:-1]), "GSB-0303", "is out of order")
        each((level < head.levels) & (key < 1 << 48), "GSB-0305", "is outside the grid")
        wide = -(-head.resolution // (edge << level.astype(np.int64)))
        each(np.all(block_places(key) < wide[:, None], axis=1), "GSB-0305", "is outside the grid")
        low, high = rows["low"], rows["high"]
        bounds = np.all((low <= high) & (high < edge), axis=1)
        each(bounds & (state <= 1), "GSB-0305", "has an impossible state or bounds")
        each((level > 0) | (rows["children"] == 0), "GSB-0305", "has children at level 0")
        each((level == 0) | (rows["children"] > 0), "GSB-0306", "has no children above level 0")
        counts = (count <= edge**3) & ((count > 0) | (state == 0))
        each(counts, "GSB-0409", "has no voxels, or more than its volume")
        content = np.frombuffer(rows.tobytes(), np.uint8).reshape(len(rows), -1)[:, 16:]
        empty = (count == 0) & ~content.any(axis=1)
        each((state == 1) | empty, "GSB-0308", "is empty and yet has voxels, bounds or columns")
        for column in head.columns:
            possible = self._are_possible(rows[column.field])
            each((state == 0) | possible, "GSB-0311", f"has an impossible column {column.id}")

    def _are_possible(self, records: Rows) -> NDArray[np.bool_]:
        """Whether a writer makes such a column record; those of unknown codecs pass."""
        begin, end = self.head.head_bytes, self.head.body_end
        offset, stored, codec = records["offset"], records["stored"], records["codec"]
        nothing = (stored == 0) & (offset == 0) & (records["crc"] == 0)
        inside = (offset >= begin) & (offset <= end) & (stored <= end - offset)
        lawful: NDArray[np.bool_] = np.where(stored == 0, nothing, inside)
        lawful &= (records["raw"] >= 1) & (records["raw"] <= MAX_RAW)
        lawful &= (codec != CONSTANT) | (stored == 0)
        lawful &= (codec > LZ4) | (stored > 0) & (records["constant"] == 0)
        return lawful


def _last_at(table: Table, order: np.uint64) -> int:
    """The last row that begins at or before a block, 0 when none does."""
    return max(0, int(np.searchsorted(table.orders, order, "right")) - 1)
