"""The pile (`.gsp`): a scratch file of finished blocks, compressed once, with an index at its end.

Layout: 16 bytes of magic, then each block's columns back to back, then the index (column table and
rows in the order of `add`), then a 48-byte footer. A pile lives and dies with its job; it is no
public format and promises nothing to another release.
"""

from collections.abc import Callable, Mapping, Sequence
from struct import Struct
from typing import BinaryIO, Final, Self

import numpy as np

from gstream.errors import CorruptFileError
from gstream.formats.columns import ColumnSpec, EncodedColumn
from gstream.formats.directory import (
    RECORD_BYTES,
    STATE_DATA,
    STATE_EMPTY,
    Rows,
    entry_dtype,
    pack_columns,
    pile_dtype,
    unpack_columns,
)
from gstream.formats.framing import PILE_MAGIC, crc32

HEAD: Final = PILE_MAGIC + bytes(4)
FOOTER: Final = Struct("<12sIQQIIII")  # magic, 0, index offset, rows, columns, row bytes, CRCs
ReadAt = Callable[[int, int], bytes]

__all__ = ["PileWriter", "ReadAt", "entry_dtype", "pile_dtype", "read_pile_rows"]


class PileWriter:
    """Appends finished blocks to an open binary file, which is only ever written forward.

    A context manager: leaving it without an error writes the index. The file is the caller's to
    open (through run/publish.py) and to close.
    """

    def __init__(self, file: BinaryIO, columns: Sequence[ColumnSpec]) -> None:
        self._file = file
        self._columns = tuple(columns)
        # pile_dtype: a Struct packs a row 15 times faster than NumPy's named fields.
        n = len(self._columns)
        self._layout = Struct(f"<QI3Bx6B2x{'QIIIIBB6x' * n}{n}QI")
        self._rows: list[bytes] = []
        self._at = file.write(HEAD)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()

    def add(
        self,
        key: int,
        level: int,
        count: int,
        low: Sequence[int],
        high: Sequence[int],
        children: int,
        encoded: Mapping[str, EncodedColumn],
    ) -> None:
        """Append one block.

        key : Morton code of the block within its level; level : 0 = finest; count : voxels
        low, high : tight bounds in voxels of the block, (x, y, z), both inclusive
        children : bit c set = child block 8 * key + c of the next finer level exists
        encoded : one EncodedColumn under each column's name; not looked at when count is 0
        """
        fields = [key, count, level, STATE_DATA if count else STATE_EMPTY, children, *low, *high]
        if count:
            columns = [encoded[column.name] for column in self._columns]
            for column in columns:
                at, stored = (self._at, len(column.data)) if column.data else (0, 0)
                fields += (at, stored, column.raw_bytes, column.crc, column.constant)
                fields += (column.codec, column.filter)
                self._at += stored and self._file.write(column.data)
            fields += [column.hash64 for column in columns]
        else:
            fields += [0] * (8 * len(self._columns))
        self._rows.append(self._layout.pack(*fields, 0))

    def close(self) -> None:
        """Write the index and the footer."""
        index = pack_columns(self._columns) + b"".join(self._rows)
        self._file.write(index)
        counts = (len(self._rows), len(self._columns), self._layout.size, crc32(index))
        footer = FOOTER.pack(PILE_MAGIC, 0, self._at, *counts, 0)[:-4]
        self._file.write(footer + crc32(footer).to_bytes(4, "little"))


def read_pile_rows(read_at: ReadAt, size: int, name: str = "pile") -> Rows:
    """The rows of one pile, in the order they were added; `pile` is 0, for the caller to number.

    read_at : (offset, length) -> exactly those bytes; size : bytes of the file; name : for messages
    errors : CorruptFileError GSP-0001 (cut or not a pile), GSP-0002 (damaged index)
    """
    if size < len(HEAD) + FOOTER.size:
        raise CorruptFileError("GSP-0001", name, size, "the pile is cut short")
    at = size - FOOTER.size
    footer = read_at(at, FOOTER.size)
    magic, zero, offset, count, columns, row_bytes, index_crc, own_crc = FOOTER.unpack(footer)
    if (magic, zero) != (PILE_MAGIC, 0) or crc32(footer[:-4]) != own_crc:
        raise CorruptFileError("GSP-0001", name, at, "the footer is missing or damaged")
    length = columns * RECORD_BYTES + count * row_bytes
    if offset + length != at:
        raise CorruptFileError("GSP-0001", name, at, "the footer's sizes do not add up to the file")
    index = read_at(offset, length)
    if crc32(index) != index_crc:
        raise CorruptFileError("GSP-0002", name, offset, "the index is damaged")
    dtype = pile_dtype(unpack_columns(index[: columns * RECORD_BYTES]))
    if dtype.itemsize != row_bytes:
        raise CorruptFileError("GSP-0002", name, offset, "the index has rows of another length")
    return np.frombuffer(index, dtype, offset=columns * RECORD_BYTES).copy()
