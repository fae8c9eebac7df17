"""Directory rows of the block file and of piles: one structured NumPy row per block.

Here: the byte layouts of entries, column records, page records and the column table, and the two
orders (of entries, of payloads). Not here: the head, reading and writing files. Layout:
spec/blockfile.md, sections 4 to 6.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError
from gstream.formats.columns import ColumnSpec, column_specs
from gstream.formats.pieces import piece_specs

Rows = NDArray[Any]  # structured, dtype entry_dtype(...) or pile_dtype(...)

MAX_HEAD_BYTES: Final = 65_536
TAIL_BYTES: Final = 64
OPENING_BYTES: Final = 4 << 20  # what the opening run should not exceed
ENTRY_BYTES: Final = 24  # without its column records
RECORD_BYTES: Final = 32  # of every table row in the file: column record, page, level, section
PAGE_ENTRIES: Final = 1024
MERGED_GAP: Final = 64 << 10  # a request costs more than so many bytes
MERGED_BYTES: Final = 1 << 20
MAX_COLUMNS: Final = 16
MAX_NAME_BYTES: Final = 24
STATE_EMPTY: Final = 0
STATE_DATA: Final = 1

RECORD_DTYPE: Final = np.dtype(
    [
        ("offset", "<u8"),  # from the start of the file; 0 when no byte is stored
        ("stored", "<u4"),  # bytes in the file
        ("raw", "<u4"),  # bytes of the decoded column
        ("crc", "<u4"),  # CRC-32 of the stored bytes
        ("constant", "<u4"),  # the packed value when codec is 2
        ("codec", "u1"),
        ("filter", "u1"),
        ("zero", "u1", 6),
    ]
)
PAGE_DTYPE: Final = np.dtype(
    [
        ("level", "u1"),  # of the first entry
        ("zero", "u1", 3),
        ("count", "<u4"),  # entries of the page, or records of the table page
        ("key", "<u8"),  # of the first entry
        ("offset", "<u8"),
        ("length", "<u4"),
        ("crc", "<u4"),
    ]
)
LEVEL_DTYPE: Final = np.dtype(
    [
        ("blocks", "<u8"),
        ("voxels", "<u8"),
        ("first", "<u8"),  # index of the level's first entry in the directory
        ("block_log2", "u1"),
        ("zero", "u1", 7),
    ]
)
COLUMN_DTYPE: Final = np.dtype(
    [("id", "<u2"), ("components", "u1"), ("bits", "u1"), ("zero", "<u4"), ("name", "S24")]
)


def entry_dtype(columns: Sequence[ColumnSpec]) -> np.dtype[Any]:
    """One directory entry: 24 bytes, then a 32-byte record under each column's `field`."""
    fields: list[Any] = [
        ("key", "<u8"),  # Morton code of the block within its level
        ("count", "<u4"),  # voxels
        ("level", "u1"),  # 0 = finest
        ("state", "u1"),
        ("children", "u1"),  # bit c: child block 8 * key + c exists; 0 at level 0
        ("flags", "u1"),
        ("low", "u1", 3),  # tight bounds in voxels of the block, x y z, both inclusive
        ("high", "u1", 3),
        ("zero", "u1", 2),
    ]
    return np.dtype(fields + [(column.field, RECORD_DTYPE) for column in columns])


def pile_dtype(columns: Sequence[ColumnSpec]) -> np.dtype[Any]:
    """An entry, then what only scratch needs: `hash` (u64 per column), `pile` (u32, which file).

    Offsets of a pile's rows are offsets in that pile.
    """
    entry = entry_dtype(columns)
    fields: list[Any] = [(name, entry[name]) for name in entry.names or ()]
    hashes = np.dtype([(column.field, "<u8") for column in columns])
    return np.dtype([*fields, ("hash", hashes), ("pile", "<u4")])


def pack_columns(columns: Sequence[ColumnSpec]) -> bytes:
    """The column table: 32 bytes per column."""
    table = np.zeros(len(columns), COLUMN_DTYPE)
    for row, column in zip(table, columns, strict=True):
        row["id"], row["components"], row["bits"] = column.id, column.components, column.bits
        row["name"] = column.name.encode()
    return table.tobytes()


def unpack_columns(table: bytes) -> tuple[ColumnSpec, ...]:
    """The inverse of pack_columns; a name that is not UTF-8 raises UnicodeDecodeError."""
    rows = np.frombuffer(table, COLUMN_DTYPE)
    return tuple(
        _spec(int(row["id"]), bytes(row["name"]).decode(), int(row["components"]), int(row["bits"]))
        for row in rows
    )


def _spec(id_: int, name: str, components: int, bits: int) -> ColumnSpec:
    """The spec of a known column; of an unknown one, as much as its table row says."""
    known = column_specs(bits).get(name) or piece_specs(bits).get(name)
    if known is not None and (known.id, known.components, known.bits) == (id_, components, bits):
        return known
    item_bytes = 1 if bits <= 8 else 2 if bits <= 16 else 4
    return ColumnSpec(id_, name, components, bits, item_bytes, ())


def entry_order(rows: Rows) -> NDArray[np.int64]:
    """Row indices in directory order: level coarse to fine, then Morton."""
    return np.lexsort((rows["key"], -rows["level"].astype(np.int64)))


def group_starts(rows: Rows) -> NDArray[np.int64]:
    """Where each sibling group begins, for rows in directory order: (groups + 1,) indices."""
    level, parent = rows["level"], rows["key"] >> np.uint64(3)
    new = np.ones(len(rows), bool)
    new[1:] = (level[1:] != level[:-1]) | (parent[1:] != parent[:-1])
    return np.append(np.flatnonzero(new), len(rows)).astype(np.int64)


def page_starts(rows: Rows, capacity: int = PAGE_ENTRIES) -> NDArray[np.int64]:
    """Where each page begins: whole sibling groups, at most `capacity` rows; last len(rows)."""
    groups = group_starts(rows)
    pages = [0]  # indices into groups
    while pages[-1] < len(groups) - 1:
        end = np.searchsorted(groups, groups[pages[-1]] + capacity, side="right") - 1
        pages.append(max(int(end), pages[-1] + 1))
    return groups[pages]


def stacked(records: Rows, columns: Sequence[ColumnSpec], field: str | None = None) -> NDArray[Any]:
    """One value per row and column, of a column record's field or of a field itself."""
    names = [column.field for column in columns]
    return np.stack([records[n][field] if field else records[n] for n in names], axis=1)


def payload_offsets(
    entries: Rows, columns: Sequence[ColumnSpec], begin: int
) -> tuple[NDArray[np.uint64], int]:
    """Where each column of each entry lies when the first payload is at `begin`.

    entries : in directory order, only whole sibling groups
    returns: (entries, columns) u64, 0 where no byte is stored; the end of the last payload
    """
    stored = stacked(entries, columns, "stored").astype(np.uint64)
    starts = group_starts(entries)
    groups = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    rows, cols = np.indices(stored.shape)
    order = np.lexsort((rows.ravel(), cols.ravel(), np.repeat(groups, len(columns))))
    sizes = stored.ravel()[order]
    ends = np.uint64(begin) + np.cumsum(sizes, dtype=np.uint64)
    offsets = np.empty(stored.size, np.uint64)
    offsets[order] = ends - sizes
    offsets[stored.ravel() == 0] = 0
    return offsets.reshape(stored.shape), int(ends[-1]) if len(ends) else begin


def payload_span(rows: Rows, columns: Sequence[ColumnSpec]) -> tuple[int, int]:
    """The byte range (begin, end) around some columns of some rows; (0, 0) where none is stored."""
    stored, offsets = stacked(rows, columns, "stored"), stacked(rows, columns, "offset")
    there = stored > 0
    if not there.any():
        return 0, 0
    return int(offsets[there].min()), int((offsets + stored)[there].max())


def opening_bytes(
    entries: Rows, columns: Sequence[ColumnSpec], before: int, blocks: NDArray[np.uint64]
) -> int:
    """Length of the opening run, from the head's end through the coarsest levels' payloads.

    entries : page 0; blocks : of each level, level 0 first
    before : bytes between the head and the first payload
    It ends behind the last level that page 0 lists whole and that ends within 4 MiB, or else
    behind what page 0 lists of the coarsest level.
    """
    stored = stacked(entries, columns, "stored").sum(axis=1, dtype=np.int64)
    end, opening = before, 0
    for level in range(int(entries["level"][0]), -1, -1):
        here = entries["level"] == level
        end += int(stored[here].sum())
        whole = int(here.sum()) == int(blocks[level])
        if not opening or (whole and end <= OPENING_BYTES):
            opening = end
        else:
            break
    return opening


def check_page_table(
    rows: Rows, total: int | None, body: tuple[int, int], path: str, at: int
) -> None:
    """Refuse page records that do not add up to `total` rows or leave the file (GSB-0206)."""
    count = rows["count"].astype(np.int64)
    if total is not None and count.sum() != total:
        said = f"the page records hold {count.sum()} rows, not {total}"
        raise CorruptFileError("GSB-0206", path, at, said)
    if rows["zero"].any() or (count < 1).any() or (count > PAGE_ENTRIES).any():
        said = f"a page record does not hold 1 to {PAGE_ENTRIES} rows, or its zeros are none"
        raise CorruptFileError("GSB-0206", path, at, said)
    offset, length = rows["offset"], rows["length"].astype(np.uint64)
    first, last = np.uint64(body[0]), np.uint64(body[1])
    if (offset < first).any() or (offset > last).any() or (length > last - offset).any():
        raise CorruptFileError("GSB-0206", path, at, "a page record points outside the body")


def merged_runs(rows: Rows, columns: Sequence[ColumnSpec]) -> list[tuple[int, int]]:
    """Byte ranges (begin, end) that hold all payloads of some rows in directory order.

    Whole sibling groups; neighbours share a range of up to MERGED_BYTES, across up to MERGED_GAP
    bytes that nobody asked for (spec, section 2).
    """
    runs: list[tuple[int, int]] = []
    for first, last in pairwise(group_starts(rows).tolist()):
        begin, end = payload_span(rows[first:last], columns)
        if begin == end:
            continue
        if runs:
            before, behind = runs[-1]
            if before <= begin <= behind + MERGED_GAP and end - before <= MERGED_BYTES:
                runs[-1] = (before, max(behind, end))
                continue
        runs.append((begin, end))
    return runs
