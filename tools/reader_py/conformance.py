"""Answers for spec/conformance/run.py, level reader, format gsb.

    python run.py --format gsb python -m gstream_tools.reader_py.conformance

Reads whole files, with the checks that need more than one page: tail, order, tree.
"""

import json
import sys
from hashlib import blake2b
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from .blockfile import BlockFile
from .directory import Rows, orders
from .errors import CorruptFileError, UnsupportedError
from .head import TAIL_BYTES, Column, need
from .source import open_source

DIGEST_BYTES = 16
SPREAD = np.array([sum((x >> i & 1) << 3 * i for i in range(8)) for x in range(256)], np.uint32)


def content(path: str) -> dict[str, Any]:
    """Counts, and digests of all values, of each level with voxels.

    errors : CorruptFileError, UnsupportedError
    """
    with BlockFile(open_source(path)) as file:
        tail = file.read(file.file_bytes - TAIL_BYTES, TAIL_BYTES)
        need(tail == file.head.tail, "GSB-0102", "does not repeat the head: truncated", "tail")
        entries = _directory(file)
        entries = entries[entries["state"] == 1]
        levels = []
        for level in range(file.levels):
            here = entries[entries["level"] == level]
            if len(here):
                levels.append(_level(file, level, here))
        return {"levels": levels}


def _directory(file: BlockFile) -> Rows:
    """All entries, in their order, each with its parent and its children."""
    pages = [file.page(i) for i in range(file.pages)]
    entries = np.concatenate(pages) if pages else np.empty(0, file.entry_dtype)
    need(len(entries) == file.blocks, "GSB-0206", f"{len(entries)} entries in all", "directory")
    ascending = orders(entries)
    in_order = bool((ascending[1:] > ascending[:-1]).all())
    need(in_order, "GSB-0303", "entries are out of order", "directory")
    for level in range(file.levels):
        above, here = (entries[entries["level"] == at] for at in (level + 1, level))
        named = np.unpackbits(above["children"][:, None], axis=1, bitorder="little").view(bool)
        children = (above["key"][:, None] << 3 | np.arange(8, dtype=np.uint64))[named]
        where = f"level {level}"
        if level + 1 < file.levels:
            parents = np.isin(here["key"] >> 3, above["key"])
            need(bool(parents.all()), "GSB-0307", "a block has no parent", where)
            same = np.array_equal(children, here["key"])
            need(same, "GSB-0306", "is not what child masks name", where)
    return entries


def _level(file: BlockFile, level: int, entries: Rows) -> dict[str, Any]:
    keys = blake2b(entries["key"].tobytes(), digest_size=DIGEST_BYTES).hexdigest()
    columns = {column.name: _digest(file, column, entries) for column in file.head.columns}
    counts = {"blocks": len(entries), "voxels": int(entries["count"].sum())}
    return {"level": level, **counts, "columns": {"key": keys} | columns}


def _digest(file: BlockFile, column: Column, entries: Rows) -> str | None:
    """The digest of a column; None when a block has it by a codec or filter that is not known."""
    digest = blake2b(digest_size=DIGEST_BYTES)
    unknown = False
    for entry in entries:
        try:
            digest.update(_values(file, column, entry))
        except UnsupportedError:
            unknown = True
            record = entry[column.field]
            stored = file.read(int(record["offset"]), int(record["stored"]))
            need(crc32(stored) == record["crc"], "GSB-0411", "another CRC", f"column {column.id}")
    return None if unknown else digest.hexdigest()


def _values(file: BlockFile, column: Column, entry: np.void) -> bytes:
    (found,) = file.load([entry], [column.name])
    return (_morton(found["words"]) if column.id == 1 else found[column.name]).tobytes()


def _morton(words: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Morton codes of x | y << 8 | z << 16."""
    codes = np.zeros(len(words), np.uint32)
    for axis in range(3):
        codes |= SPREAD[words >> 8 * axis & 255] << axis
    return codes


def answer(path: str) -> dict[str, Any]:
    """One answer of the protocol in spec/conformance/README.md."""
    try:
        return {"valid": True, "codes": [], "content": content(path)}
    except CorruptFileError as error:
        return {"valid": False, "codes": [error.rule]}
    except UnsupportedError:
        return {"valid": False, "codes": ["unsupported"]}


if __name__ == "__main__":
    for line in sys.stdin:
        print(json.dumps(answer(line.rstrip("\n"))), flush=True)
