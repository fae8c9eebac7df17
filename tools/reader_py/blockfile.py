"""An open block file: head at once, pages and columns by ranges when they are asked for.

Spec: spec/blockfile.md. One thread may load while others look things up.
"""

from collections.abc import Iterable, Iterator, Sequence
from threading import Lock
from typing import NamedTuple, Self
from zlib import crc32

import numpy as np

from .columns import Record, Values, constant_values, decode, filtered_bytes, items_of
from .directory import CONSTANT, Directory, Rows
from .errors import UnsupportedError
from .head import MAX_HEAD_BYTES, TRIANGLE, Column, need, parse_head
from .source import Source

MAX_GAP = 64 << 10  # ranges closer than this are one request
MAX_RUN = 8 << 20  # but no request grows above this by joining
MAX_OPENING = 64 << 20  # of the opening run, that is kept; it has 4 MiB unless one level has more


class Piece(NamedTuple):
    """Stored bytes that are wanted: a column of a block."""

    offset: int
    end: int
    number: int  # of the block among those asked for
    column: Column
    record: Record
    length: int  # of the column before its codec
    items: int
    where: str  # for errors


class BlockFile:
    """An open block file.

    errors : CorruptFileError or UnsupportedError for the file, OSError for where it lies
    """

    def __init__(self, source: Source) -> None:
        """Read the head, with one request; an error here closes the source, as close() does."""
        self.source = source
        self._lock = Lock()
        try:
            self._known = source.read(0, MAX_HEAD_BYTES)  # the file from its start, as far as kept
            self.head = head = parse_head(self._known)
            self._directory = Directory(head, self.read)
            said = f"the file has {source.size} bytes, not {head.file_bytes}: truncated"
            need(source.size in (None, head.file_bytes), "GSB-0102", said)
        except BaseException:
            source.close()
            raise
        self.entry_dtype = self._directory.dtype
        self.resolution = head.resolution
        self.levels = head.levels
        self.block_log2 = head.block_log2
        self.normal_bits = head.normal_bits
        self.separability = head.separability
        self.snap_bits = head.snap_bits
        self.faces = head.faces
        self.matrix = head.matrix
        self.box = head.box
        self.columns = {column.id: column.name for column in head.columns}
        self.level_blocks = head.level_blocks
        self.level_voxels = head.level_voxels
        self.blocks = head.blocks
        self.pages = head.pages
        self.file_bytes = head.file_bytes
        self.content_id = head.content_id
        self.metadata = head.metadata
        self.opening_bytes = head.opening_bytes

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the source."""
        self.source.close()

    def read(self, offset: int, length: int) -> bytes:
        """Exactly so many bytes, from memory or with one request."""
        if offset + length <= len(self._known):
            return self._known[offset : offset + length]
        with self._lock:
            data = self.source.read(offset, length)
        said = f"wanted {length} bytes, got {len(data)}: truncated"
        need(len(data) == length, "GSB-0102", said, f"byte {offset}")
        return data

    def load_opening(self) -> None:
        """Read and keep the opening run, with one request at most."""
        missing = self.head.head_bytes + min(self.opening_bytes, MAX_OPENING) - len(self._known)
        if missing > 0:
            self._known += self.read(len(self._known), missing)

    def page_of(self, level: int, key: int) -> int:
        """The page that has a block if the file has it; may read a table page at depth 2."""
        return self._directory.page_of(level, key)

    def page(self, page: int) -> Rows:
        """(n,) read-only entries: key, count, level, state, children, low (3,), high (3,), and a
        record by the name of every known column. Read with one request, checked, and kept.
        """
        return self._directory.page(page)

    def page_is_loaded(self, page: int) -> bool:
        """Whether the page is in memory."""
        return self._directory.is_loaded(page)

    def constant(self, entry: np.void, name: str) -> int | None:
        """The packed value of a column that is the same in all voxels; None for another."""
        column = self._column(name)
        record = Record(*entry[column.field].item()[:-1])
        if record.codec != CONSTANT:
            return None
        constant_values(column, record, f"column {name!r} of block {entry['key']}")
        return record.constant

    def load(self, entries: Sequence[np.void], names: Sequence[str]) -> list[dict[str, Values]]:
        """Columns of some blocks, of any pages: close ranges are fetched with one request.

        returns: of each entry in order, values by name: `normal` (n, 2) u16 codes, `colour` (n, 4)
            u8, `vertex` (v, 3) u32 snap units from the block's low corner, `triangle` (t, 3) u32
            rows of it, others (n,). For `occupancy` stands `words` (n,) u32: x | y << 8 | z << 16
            within the block, and the face mask in bits 24 to 29 when `mask` is asked for too
        """
        columns = [self._column(name) for name in names]
        loaded: list[dict[str, Values]] = []
        pieces: list[Piece] = []
        for number, entry in enumerate(entries):
            loaded.append({})
            if entry["state"]:
                pieces += self._pieces(number, entry, columns)
            else:
                loaded[-1] = {column.name: _nothing(column) for column in columns}
        for piece, stored in self.stored(pieces):
            _, _, number, column, record, length, count, where = piece
            values = decode(column, record, stored, length, count, self.block_log2, where)
            if column.id == TRIANGLE and count:
                known = entries[number][self._column("vertex").field]["raw"] // 12
                need(int(values.max()) < known, "GSB-0413", f"has {known} vertices", where)
            loaded[number][column.name] = values
        for found in loaded:
            if "occupancy" in found:
                found["words"] = found.pop("occupancy")
                if "mask" in found:
                    found["words"] |= found["mask"].astype(np.uint32) << 24
        return loaded

    def stored(self, pieces: Iterable[Piece]) -> Iterator[tuple[Piece, memoryview]]:
        """The stored bytes of columns, their CRC checked, in the order of the file."""
        for run in _runs(pieces, len(self._known)):
            begin, end = run[0].offset, max(piece.end for piece in run)
            data = memoryview(self.read(begin, end - begin) if end > begin else b"")
            for piece in run:
                part = data[piece.offset - begin : piece.end - begin]
                need(crc32(part) == piece.record.crc, "GSB-0411", "has another CRC", piece.where)
                yield piece, part

    def _column(self, name: str) -> Column:
        for column in self.head.columns:
            if column.name == name:
                if not column.item_bytes:
                    raise UnsupportedError(f"column {name!r} is of a kind that is not known")
                return column
        raise UnsupportedError(f"the file stores no column {name!r}")

    def _pieces(self, number: int, entry: np.void, columns: list[Column]) -> Iterator[Piece]:
        key, count, level = (int(entry[name]) for name in ("key", "count", "level"))
        for column in columns:
            where = f"column {column.name!r} of block {key} of level {level}"
            record = Record(*entry[column.field].item()[:-1])
            items = items_of(column, record, count)
            length = filtered_bytes(column, record, items, self.block_log2, where)
            end = record.offset + record.stored
            yield Piece(record.offset, end, number, column, record, length, items, where)


def _nothing(column: Column) -> Values:
    shape = (0, column.components) if column.components > 1 else (0,)
    return np.zeros(shape, f"<u{4 if column.id == 1 else column.item_bytes}")


def _runs(pieces: Iterable[Piece], known: int) -> Iterator[list[Piece]]:
    """Pieces to be fetched together; those before byte `known`, which is in memory, stay alone."""
    run: list[Piece] = []
    begin = end = 0
    for piece in sorted(pieces, key=lambda piece: piece.offset):
        near = piece.offset <= end + MAX_GAP and max(end, piece.end) <= begin + MAX_RUN
        if run and (end <= known or not near):
            yield run
            run = []
        begin, end = (begin, max(end, piece.end)) if run else (piece.offset, piece.end)
        run.append(piece)
    if run:
        yield run
