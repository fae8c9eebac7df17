"""The rules of the geometry stream, and a check of a whole one: one finding per rule and place.

What a reader needs to be safe, stream.py checks on every read; here is what only a checker needs.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError
from gstream.formats.findings import ERROR, NOTE, READER, VALIDATOR, Finding, Rule, broken
from gstream.formats.stream import StreamReader, total_box
from gstream.formats.stream_chunk import ID_INDEX, POSITION_F4, POSITION_F8, ChunkHead
from gstream.formats.stream_parts import unreadable

RULES: Final = (
    Rule("GST-0001", ERROR, READER, "3",
         "The file begins with the 12 bytes of the magic."),
    Rule("GST-0002", ERROR, READER, "3",
         "The file does not end inside its header."),
    Rule("GST-0003", ERROR, READER, "3",
         "The header matches its CRC."),
    Rule("GST-0004", ERROR, READER, "3",
         "Attributes and metadata are within their limits."),
    Rule("GST-0005", ERROR, VALIDATOR, "3",
         "Reserved bytes of the header are zero."),
    Rule("GST-0006", ERROR, VALIDATOR, "3.1",
         "A descriptor is well formed and stands once; a known one is as the spec has it."),
    Rule("GST-0007", ERROR, VALIDATOR, "3.2",
         "The metadata is a UTF-8 JSON object."),
    Rule("GST-0101", ERROR, READER, "4",
         "A chunk begins with its magic."),
    Rule("GST-0102", ERROR, READER, "4",
         "The file does not end inside a chunk's head."),
    Rule("GST-0103", ERROR, READER, "4",
         "A chunk's head matches its CRC."),
    Rule("GST-0104", ERROR, READER, "4",
         "Chunks and parts are within their limits."),
    Rule("GST-0105", ERROR, READER, "4",
         "A chunk is as long as its head and parts."),
    Rule("GST-0106", ERROR, VALIDATOR, "4.1",
         "Reserved bytes of a part record are zero."),
    Rule("GST-0107", ERROR, READER, "5",
         "A part's sizes, index width and filter fit the chunk."),
    Rule("GST-0108", ERROR, READER, "4",
         "There is one position part, no attribute stands twice, and indices come first."),
    Rule("GST-0109", ERROR, READER, "4",
         "A chunk without indices has three vertices per triangle."),
    Rule("GST-0111", ERROR, READER, "4.1",
         "A part matches its CRC."),
    Rule("GST-0112", ERROR, READER, "4",
         "Every index is below the number of vertices."),
    Rule("GST-0113", ERROR, READER, "5.1",
         "An LZ4 block unpacks to exactly the length stated, which is a possible one."),
    Rule("GST-0114", ERROR, READER, "5.2",
         "First-use and edge codes are sound and use every vertex."),
    Rule("GST-0115", ERROR, READER, "4",
         "A box is finite."),
    Rule("GST-0116", ERROR, VALIDATOR, "4",
         "The number of degenerate triangles is right."),
    Rule("GST-0117", ERROR, READER, "4",
         "A box is the tight box of the chunk's vertices, which are finite."),
    Rule("GST-0118", ERROR, VALIDATOR, "4",
         "A part's attribute has a descriptor."),
    Rule("GST-0119", NOTE, READER, "4.1",
         "A part of an unknown attribute, domain, codec or filter is not checked."),
    Rule("GST-0201", ERROR, READER, "7",
         "The file ends in a tail: it is not cut."),
    Rule("GST-0202", ERROR, READER, "7",
         "The tail matches its CRC."),
    Rule("GST-0203", ERROR, READER, "7",
         "The file has the length that its tail states."),
    Rule("GST-0204", ERROR, READER, "7",
         "The directory ends where the tail begins."),
    Rule("GST-0205", ERROR, READER, "7",
         "The directory matches its CRC."),
    Rule("GST-0206", ERROR, READER, "6",
         "The directory is well formed."),
    Rule("GST-0207", ERROR, READER, "6.1",
         "A row of the directory repeats its chunk's head."),
    Rule("GST-0208", ERROR, READER, "6.1",
         "Chunks stand one behind the other, without gaps or overlaps."),
    Rule("GST-0209", ERROR, VALIDATOR, "6.2",
         "The totals are a UTF-8 JSON object with a list of sources and their counters."),
    Rule("GST-0210", ERROR, VALIDATOR, "6.2",
         "Counters are the sums over the chunks, and read = stored + non-finite."),
    Rule("GST-0211", ERROR, READER, "7",
         "Header and tail are of one file."),
    Rule("GST-0212", ERROR, READER, "6",
         "The directory is within its limits."),
    Rule("GST-0213", ERROR, VALIDATOR, "6.2",
         "The totals' box is the box of all chunks."),
)  # fmt: skip

COUNTERS: Final = ("read", "stored", "non_finite", "degenerate")


def iter_findings(path: str | Path, quick: bool = False) -> Iterator[Finding]:
    """Every finding in a stream, in file order, notes last; memory is bounded by one chunk.

    quick: read header, chunk heads, directory and tail only, no payload
    errors: UnsupportedError when the file needs a newer reader
    """
    try:
        reader = StreamReader(path)
    except CorruptFileError as error:
        yield broken(error)
        return
    declared = {attribute.id for attribute in reader.attributes} | {ID_INDEX}
    sums: dict[int, NDArray[np.int64]] = {}
    unchecked: dict[int, str] = {}  # attribute -> what of it is unknown
    unknown = False  # whether a chunk's counters could not be read
    for index in range(len(reader.chunks)):
        try:
            head = reader.head(index)
            yield from _undeclared(reader, index, head, declared)
            sums.setdefault(head.source, np.zeros(3, np.int64))
            sums[head.source] += (head.triangles, head.non_finite, head.degenerate)
            if not quick:
                yield from _payload(reader, index, head)
                unchecked |= unreadable(head)
        except CorruptFileError as error:
            unknown = True
            yield broken(error)
    if not unknown:
        yield from _totals(reader, sums)
    for attribute, said in sorted(unchecked.items()):
        said = f"this release does not know its {said}: only its CRC was checked"
        yield Finding("GST-0119", NOTE, f"attribute {attribute}", said)


def _undeclared(
    reader: StreamReader, index: int, head: ChunkHead, declared: set[int]
) -> Iterator[Finding]:
    for part in head.parts:
        if part.attribute not in declared:
            said = f"attribute {part.attribute} has no descriptor in the header"
            yield _finding(reader, index, "GST-0118", said)


def _payload(reader: StreamReader, index: int, head: ChunkHead) -> Iterator[Finding]:
    """Unpack everything that this version knows; of the rest, only the CRC can be checked."""
    values = reader.parts(index)
    positions = values.get(POSITION_F4.id, values.get(POSITION_F8.id))
    corners = values.get(ID_INDEX) if head.index_bytes else np.arange(head.vertices)
    if positions is None or corners is None:
        return
    found = count_degenerate(positions, corners.reshape(-1, 3))
    if found != head.degenerate:
        said = f"{head.degenerate} degenerate triangles are stated, {found} found"
        yield _finding(reader, index, "GST-0116", said)


def count_degenerate(positions: NDArray[Any], triangles: NDArray[Any]) -> int:
    """Triangles (t, 3) with two corners at the same place; -0.0 equals +0.0."""
    axes = np.take(np.ascontiguousarray(positions.T), triangles.T, axis=1)  # (axis, corner, t)
    same = (axes == np.roll(axes, 1, axis=1)).all(axis=0).any(axis=0)
    return int(same.sum())


def _totals(reader: StreamReader, sums: Mapping[int, NDArray[np.int64]]) -> Iterator[Finding]:
    sources = reader.totals.get("sources")
    if not isinstance(sources, list) or not all(map(is_source, sources)):
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


def is_source(value: Any) -> bool:
    """Whether an item of the totals' sources has its counters."""
    return isinstance(value, dict) and all(
        type(value.get(key)) is int and 0 <= value[key] < 1 << 64 for key in COUNTERS
    )


def _finding(reader: StreamReader, index: int | None, rule: str, said: str) -> Finding:
    chunks = reader.chunks
    if index is not None:
        return Finding(rule, ERROR, f"byte {chunks[index]['offset']}", f"chunk {index}: {said}")
    at = int(chunks[-1]["offset"] + chunks[-1]["length"]) if len(chunks) else reader.header_bytes
    return Finding(rule, ERROR, f"byte {at}", said)
