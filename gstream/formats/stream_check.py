"""Checks a whole geometry stream against spec/stream.md; one finding per broken rule and place.

What a reader needs to be safe, stream.py checks on every read; here is what only a checker needs.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError
from gstream.formats.framing import crc32
from gstream.formats.stream import StreamReader, total_box
from gstream.formats.stream_chunk import ID_INDEX, KNOWN, Chunk, ChunkHead

COUNTERS: Final = ("read", "stored", "non_finite", "degenerate")


def iter_findings(path: str | Path, quick: bool = False) -> Iterator[CorruptFileError]:
    """Every broken rule of the file, in file order; memory is bounded by one chunk.

    quick: read header, chunk heads, directory and tail only, no payload
    errors: UnsupportedError when the file needs a newer reader
    """
    try:
        reader = StreamReader(path)
    except CorruptFileError as finding:
        yield finding
        return
    declared = {attribute.id for attribute in reader.attributes} | {ID_INDEX}
    sums: dict[int, NDArray[np.int64]] = {}
    unknown = False  # whether a chunk's counters could not be read
    for index in range(len(reader.chunks)):
        try:
            head = reader.head(index)
            yield from _undeclared(reader, index, head, declared)
            sums.setdefault(head.source, np.zeros(3, np.int64))
            sums[head.source] += (head.triangles, head.non_finite, head.degenerate)
            if not quick:
                yield from _payload(reader, index, head)
        except CorruptFileError as finding:
            unknown = True
            yield finding
    if not unknown:
        yield from _totals(reader, sums)


def _undeclared(
    reader: StreamReader, index: int, head: ChunkHead, declared: set[int]
) -> Iterator[CorruptFileError]:
    for part in head.parts:
        if part.attribute not in declared:
            said = f"attribute {part.attribute} has no descriptor in the header"
            yield _finding(reader, index, "GST-0118", said)


def _payload(reader: StreamReader, index: int, head: ChunkHead) -> Iterator[CorruptFileError]:
    """Unpack everything that this version knows; of the rest, only the CRC can be checked."""
    chunk = reader.chunk(index)
    found = count_degenerate(chunk)
    if found != head.degenerate:
        said = f"{head.degenerate} degenerate triangles are stated, {found} found"
        yield _finding(reader, index, "GST-0116", said)
    at = int(reader.chunks[index]["offset"]) + head.size
    for part in head.parts:
        if part.attribute not in KNOWN and crc32(reader.read(at, part.stored)) != part.crc:
            said = f"the CRC of attribute {part.attribute} is wrong"
            yield CorruptFileError("GST-0111", reader.path, at, said)
        at += part.stored


def count_degenerate(chunk: Chunk) -> int:
    """Triangles with two corners at the same place; -0.0 equals +0.0."""
    rows = chunk.triangles
    if rows is None:
        rows = np.arange(len(chunk.positions)).reshape(-1, 3)
    axes = np.take(np.ascontiguousarray(chunk.positions.T), rows.T, axis=1)  # (axis, corner, t)
    same = (axes == np.roll(axes, 1, axis=1)).all(axis=0).any(axis=0)
    return int(same.sum())


def _totals(
    reader: StreamReader, sums: Mapping[int, NDArray[np.int64]]
) -> Iterator[CorruptFileError]:
    sources = reader.totals.get("sources")
    if not isinstance(sources, list) or not all(map(_is_source, sources)):
        yield _finding(reader, None, "GST-0209", "the totals have no list of sources and counters")
        return
    if any(number >= len(sources) for number in sums):
        said = f"chunks are of source {max(sums)}, the totals have {len(sources)}"
        yield _finding(reader, None, "GST-0210", said)
    for number, source in enumerate(sources):
        found = sums.get(number, np.zeros(3, np.int64)).tolist()
        stated = [source["stored"], source["non_finite"], source["degenerate"]]
        if found != stated:
            said = f"source {number} states stored, non-finite, degenerate {stated}, found {found}"
            yield _finding(reader, None, "GST-0210", said)
        if source["read"] != source["stored"] + source["non_finite"]:
            said = f"source {number}: triangles read are not stored plus non-finite"
            yield _finding(reader, None, "GST-0210", said)
    box = total_box(reader.chunks)
    if reader.totals.get("box") != (None if box is None else [list(corner) for corner in box]):
        yield _finding(reader, None, "GST-0213", "the totals' box is not the box of all chunks")


def _is_source(value: Any) -> bool:
    return isinstance(value, dict) and all(
        isinstance(value.get(key), int) and value[key] >= 0 for key in COUNTERS
    )


def _finding(reader: StreamReader, index: int | None, rule: str, said: str) -> CorruptFileError:
    chunks = reader.chunks
    if index is not None:
        said = f"chunk {index}: {said}"
        return CorruptFileError(rule, reader.path, int(chunks[index]["offset"]), said)
    at = int(chunks[-1]["offset"] + chunks[-1]["length"]) if len(chunks) else reader.header_bytes
    return CorruptFileError(rule, reader.path, at, said)
