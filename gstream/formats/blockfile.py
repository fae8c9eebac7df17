"""Writing a block file (`.gsb`) strictly forward from the rows of piles, without decoding a block.

Here: the order of bytes in the body, the content id, and the copy of compressed payloads. The head
is formats/blockhead.py, rows are formats/directory.py, reading is gstream/read.py. Layout:
spec/blockfile.md, sections 2 and 5 to 8.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from itertools import pairwise
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, RefusedError
from gstream.formats.blockhead import (
    MAX_BLOCKS,
    PAGE_CAPACITY,
    BlockFileHeader,
    Head,
    Section,
    head_length,
    pack_head,
    pack_tail,
    parse_head,
)
from gstream.formats.blockmeta import MAX_META_BYTES, meta_bytes
from gstream.formats.columns import ColumnSpec
from gstream.formats.directory import (
    LEVEL_DTYPE,
    PAGE_DTYPE,
    PAGE_ENTRIES,
    RECORD_BYTES,
    TAIL_BYTES,
    Rows,
    entry_dtype,
    entry_order,
    group_starts,
    opening_bytes,
    pack_columns,
    page_starts,
    payload_offsets,
    stacked,
)
from gstream.formats.framing import crc32

Fetch = Callable[[int, int, int], bytes]  # pile, offset, length -> exactly those bytes
Progress = Callable[[int, int], None]  # blocks written, blocks in all

CONTENT_ID_BYTES: Final = 16


@dataclass(frozen=True, slots=True)
class Paging:
    """How many rows go where; only tests use other numbers, to reach depth 2 with few blocks."""

    entries: int = PAGE_ENTRIES  # directory entries per page
    head_records: int = PAGE_CAPACITY  # page records in the head; more of them make depth 2
    table_records: int = PAGE_ENTRIES  # page records per table page


DEFAULT_PAGING: Final = Paging()


def write_block_file(
    file: BinaryIO,
    header: BlockFileHeader,
    rows: Rows,
    fetch: Fetch,
    meta: Mapping[str, Any],
    columns: Sequence[ColumnSpec],
    progress: Progress | None = None,
    *,
    paging: Paging = DEFAULT_PAGING,
    extra: Sequence[tuple[bytes, bytes]] = (),
) -> Head:
    """Write a block file from finished blocks.

    file : open binary file, written forward only
    rows : pile_dtype rows in any order, at least the columns kept; `pile` says which pile
    fetch : (pile, offset, length) -> compressed bytes
    meta : units, up, crs (string or None, only what is known) and `ledger`, whose `voxels` are set
    columns : the columns kept, ascending ids; others in the rows are dropped
    extra : ancillary sections (type of 4 bytes, body) behind the body
    returns: the head as written
    errors : CorruptFileError GSP-0003 (two blocks of one key), GSP-0004 (a damaged payload);
             RefusedError for more than 2^24 blocks or a metadata section above 12 KiB
    """
    layout = _Layout(rows, tuple(columns), paging)
    voxels = voxels_per_level(rows, header.levels)
    meta = {**meta, "ledger": {**meta.get("ledger", {}), "voxels": voxels}}
    if len(meta_bytes(meta)) > MAX_META_BYTES:
        raise RefusedError(f"metadata above {MAX_META_BYTES} bytes", "shorten units, up or crs")
    head = layout.head(header, meta, extra)
    data = pack_head(head)
    head = parse_head(data, "the new block file")  # what is written is what readers accept
    file.write(data)
    layout.write(file, fetch, progress)
    for _, body in extra:
        file.write(body)
    file.write(pack_tail(head, head.crc))
    return head


def canonical_settings(settings: bytes, columns: Sequence[ColumnSpec]) -> bytes:
    """What the content id begins with: bytes 56 to 215 of the head and the column table."""
    return settings + pack_columns(columns)


def voxels_per_level(rows: Rows, levels: int) -> list[int]:
    """Voxels of each level, level 0 first."""
    totals = [rows["count"][rows["level"] == level].sum(dtype=np.int64) for level in range(levels)]
    return [int(total) for total in totals]


def identity_rows(entries: Rows, hashes: NDArray[np.uint64]) -> bytes:
    """What the content id covers of entries: key u64, level u8, count u32, a u64 hash per column.

    hashes : (entries, columns) u64, 0 for the columns of an empty block
    """
    kind = [("key", "<u8"), ("level", "u1"), ("count", "<u4"), ("hash", "<u8", hashes.shape[1:])]
    table = np.empty(len(entries), np.dtype(kind))
    for name in ("key", "level", "count"):
        table[name] = entries[name]
    table["hash"] = hashes
    return table.tobytes()


class _Layout:
    """Where every byte of the body goes: first sizes, hashes and CRCs, then the bytes."""

    def __init__(self, rows: Rows, columns: tuple[ColumnSpec, ...], paging: Paging) -> None:
        if len(rows) > MAX_BLOCKS:
            said = f"{len(rows)} blocks are above the limit of {MAX_BLOCKS}"
            raise RefusedError(said, "use larger blocks or a lower resolution")
        self.rows, self.columns, self.dtype = rows, columns, entry_dtype(columns)
        self.order = entry_order(rows)
        self.keys = keys = rows[["level", "key"]][self.order]
        twice = np.flatnonzero(keys[1:] == keys[:-1])
        if len(twice):
            said = f"two finished blocks have key {keys[twice[0]]['key']} of one level"
            raise CorruptFileError("GSP-0003", "pile", 0, said)
        self.starts = page_starts(keys, paging.entries)
        self.pages = self._records(self.starts, self.dtype.itemsize)
        self.tables = self.pages[:0]
        if len(self.pages) > paging.head_records:
            cuts = np.append(np.arange(0, len(self.pages), paging.table_records), len(self.pages))
            self.tables = self._records(cuts, RECORD_BYTES)
            for name in ("level", "key"):
                self.tables[name] = self.pages[name][cuts[:-1]]
        self.begins = np.zeros(len(self.pages), np.int64)  # of each page's payloads

    def _records(self, starts: NDArray[np.int64], row_bytes: int) -> Rows:
        records = np.zeros(len(starts) - 1, PAGE_DTYPE)
        records["count"] = np.diff(starts)
        records["length"] = records["count"] * np.uint32(row_bytes)
        if row_bytes != RECORD_BYTES:
            for name in ("level", "key"):
                records[name] = self.keys[name][starts[:-1]]
        return records

    def steps(self) -> Iterator[tuple[str, int]]:
        """The body in file order: what comes next, and which one of its kind."""
        tables, pages = len(self.tables), len(self.pages)
        for first, last in ((0, 1), (1, max(tables, pages))):
            yield from (("table", i) for i in range(first, min(last, tables)))
            yield from (("page", i) for i in range(first, min(last, pages)))
            yield from (("payloads", i) for i in range(first, min(last, pages)))

    def place(self, at: int, identity: Any) -> int:
        """Set every offset and CRC from the head's end on, feed the content id; the body's end."""
        for kind, i in self.steps():
            if kind == "payloads":
                self.begins[i] = at
                entries, source, at = self.entries(i)
                hashes = stacked(source["hash"], self.columns)
                identity.update(identity_rows(entries, hashes))
                self.pages["crc"][i] = crc32(entries.tobytes())
            else:
                record = (self.tables if kind == "table" else self.pages)[i]
                record["offset"] = at
                at += int(record["length"])
        for i in range(len(self.tables)):
            self.tables["crc"][i] = crc32(self.table_page(i))
        return at

    def table_page(self, i: int) -> bytes:
        first = int(self.tables["count"][:i].sum())
        return self.pages[first : first + int(self.tables["count"][i])].tobytes()

    def entries(self, page: int) -> tuple[Rows, Rows, int]:
        """(entries of one page with offsets in the file, their rows, end of their payloads)."""
        source = self.rows[self.order[self.starts[page] : self.starts[page + 1]]]
        entries = np.zeros(len(source), self.dtype)
        for name in self.dtype.names or ():
            entries[name] = source[name]
        offsets, end = payload_offsets(entries, self.columns, int(self.begins[page]))
        for column, place in zip(self.columns, offsets.T, strict=True):
            entries[column.field]["offset"] = place
        return entries, source, end

    def head(
        self, header: BlockFileHeader, meta: Mapping[str, Any], extra: Sequence[tuple[bytes, bytes]]
    ) -> Head:
        """Place everything, and return the complete head."""
        settings = canonical_settings(header.pack(), self.columns)
        identity = blake2b(settings, digest_size=CONTENT_ID_BYTES)
        records = self.tables if len(self.tables) else self.pages
        lengths = (header.levels, len(self.columns), len(records))
        head_bytes = head_length(*lengths, meta_bytes(meta), len(extra))
        end = self.place(head_bytes, identity)
        levels = self.level_table(header)
        sections = []
        for kind, body in extra:
            sections.append(Section(kind, False, end, len(body), crc32(body)))
            end += len(body)
        opening = 0
        if len(self.pages):
            entries, _, _ = self.entries(0)
            before = int(self.begins[0]) - head_bytes
            opening = opening_bytes(entries, self.columns, before, levels["blocks"])
        return Head(
            header,
            self.columns,
            levels,
            records,
            meta,
            blocks=len(self.rows),
            pages=len(self.pages),
            opening_bytes=opening,
            depth=2 if len(self.tables) else 1,
            head_bytes=head_bytes,
            file_bytes=end + TAIL_BYTES,
            content_id=identity.digest(),
            sections=tuple(sections),
        )

    def level_table(self, header: BlockFileHeader) -> Rows:
        levels = np.zeros(header.levels, LEVEL_DTYPE)
        levels["blocks"] = np.bincount(self.rows["level"], minlength=header.levels)
        levels["voxels"] = voxels_per_level(self.rows, header.levels)
        levels["first"] = np.cumsum(levels["blocks"][::-1])[::-1] - levels["blocks"]
        levels["block_log2"] = header.block_log2
        return levels

    def write(self, file: BinaryIO, fetch: Fetch, progress: Progress | None) -> None:
        """Write the body."""
        done = 0
        for kind, i in self.steps():
            if kind == "table":
                file.write(self.table_page(i))
                continue
            entries, source, _ = self.entries(i)
            if kind == "page":
                file.write(entries.tobytes())
                continue
            blocks = _pile_blocks(source, self.columns)
            for first, last in pairwise(group_starts(source).tolist()):
                for payload in _group_payloads(blocks[first:last], fetch):
                    file.write(payload)
                done += last - first
                if progress:
                    progress(done, len(self.rows))


@dataclass(frozen=True, slots=True)
class _PileBlock:
    """Where one block's kept columns lie in a pile; plain integers, being read one by one."""

    pile: int
    places: list[tuple[int, int, int]]  # offset, stored bytes, CRC of each column

    def fetch(self, fetch: Fetch) -> tuple[int, bytes]:
        """(offset, bytes) of the run that holds all columns of which something is stored."""
        ends = [(at, at + stored) for at, stored, _ in self.places if stored]
        first, last = min(ends, default=(0, 0))[0], max((end for _, end in ends), default=0)
        return first, fetch(self.pile, first, last - first) if ends else b""


def _pile_blocks(rows: Rows, columns: Sequence[ColumnSpec]) -> list[_PileBlock]:
    fields = [stacked(rows, columns, name).tolist() for name in ("offset", "stored", "crc")]
    places = zip(rows["pile"].tolist(), *fields, strict=True)
    return [_PileBlock(pile, list(zip(*block, strict=True))) for pile, *block in places]


def _group_payloads(group: Sequence[_PileBlock], fetch: Fetch) -> Iterator[bytes]:
    """The stored columns of one sibling group, column by column; one fetch per block."""
    runs = [block.fetch(fetch) for block in group]
    for column in range(len(group[0].places)):
        for block, (first, data) in zip(group, runs, strict=True):
            offset, stored, crc = block.places[column]
            payload = data[offset - first : offset - first + stored] if stored else b""
            if crc32(payload) != crc:
                said = "a column of a finished block is damaged"
                raise CorruptFileError("GSP-0004", f"pile {block.pile}", offset, said)
            yield payload
