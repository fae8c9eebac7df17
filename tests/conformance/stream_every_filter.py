"""A geometry stream with every part by every filter and codec; from spec/stream.md alone."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import replace

from conformance.stream_bytes import (
    COLOUR,
    EDGE_CHUNK,
    EDGE_CODES,
    FAN,
    FAN_BOX,
    NORMAL,
    POSITION,
    POSITION_F8,
    ChunkBytes,
    PartBytes,
    StreamBytes,
    counters,
    floats,
    pack,
)

TRIANGLES = ((0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1))
NORMALS = ((0.0, 0.0, 1.0), (0.0, 0.6, 0.8), (0.0, -0.6, 0.8), (-0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
COLOURS = ((250, 10, 0, 255), (251, 9, 0, 255), (3, 8, 128, 0), (3, 8, 127, 255), (4, 7, 255, 1))


def planes(numbers: Sequence[Sequence[int]], width: int) -> bytes:
    """Byte planes: component by component, of each the lowest bytes first."""
    columns = list(zip(*numbers, strict=True))
    return bytes(n >> 8 * byte & 255 for column in columns for byte in range(width) for n in column)


def zigzag(difference: int, width: int) -> int:
    half = 1 << 8 * width - 1
    signed = (difference + half) % (2 * half) - half
    return 2 * signed if signed >= 0 else -2 * signed - 1


def base(vertex: int) -> int:
    """The row that a vertex is a difference to; -1 stands for zeros."""
    corners = next(triangle for triangle in TRIANGLES if vertex in triangle)
    return max((corner for corner in corners if corner < vertex), default=vertex - 1)


def deltas(rows: Sequence[Sequence[int]], bases: Iterable[int], width: int) -> bytes:
    padded = [*rows, (0,) * len(rows[0])]
    return planes(
        [
            [zigzag(value - before, width) for value, before in zip(row, padded[at], strict=True)]
            for row, at in zip(rows, bases, strict=True)
        ],
        width,
    )


def ordered(value: float, letter: str) -> int:
    width = struct.calcsize(letter)
    bits = int.from_bytes(struct.pack("<" + letter, value), "little")
    half = 1 << 8 * width - 1
    return 2 * half - 1 - bits if bits & half else bits + half


def ways_of_floats(rows: Sequence[Sequence[float]], letter: str) -> dict[int, bytes]:
    """Raw bytes by filter."""
    numbers = [[ordered(value, letter) for value in row] for row in rows]
    width, ids = struct.calcsize(letter), range(len(rows))
    by_row = deltas(numbers, (i - 1 for i in ids), width)
    by_base = deltas(numbers, map(base, ids), width)
    return {0: floats(rows, letter), 2: by_row, 5: by_base}


def ways_of_colours() -> dict[int, bytes]:
    by_row = deltas(COLOURS, (i - 1 for i in range(len(COLOURS))), 1)
    by_base = deltas(COLOURS, map(base, range(len(COLOURS))), 1)
    return {0: bytes(sum(COLOURS, ())), 1: by_row, 4: by_base}


def ways_of_indices() -> dict[int, bytes]:
    corners, mark, codes = sum(TRIANGLES, ()), 0, []
    for corner in corners:
        codes.append([mark - corner])
        mark += corner == mark
    return {0: struct.pack("<12H", *corners), 3: planes(codes, 2), 6: EDGE_CODES}


def chunk(position: int, letter: str, way: int, codec: int) -> ChunkBytes:
    """A chunk whose parts take the filter of this number, of those that each may have."""

    def part(attribute: int, domain: int, ways: dict[int, bytes]) -> PartBytes:
        filter_, raw = list(ways.items())[way]
        return PartBytes(attribute, domain, pack(raw) if codec else raw, len(raw), filter_, codec)

    parts = (
        part(0, 1, ways_of_indices()),
        part(position, 0, ways_of_floats(FAN, letter)),
        part(3, 0, ways_of_floats(NORMALS, "f")),
        part(4, 0, ways_of_colours()),
    )
    return replace(EDGE_CHUNK, parts=parts, non_finite=0)


EVERY_FILTER = StreamBytes(
    tuple(
        chunk(position, letter, way, codec)
        for position, letter in ((1, "f"), (2, "d"))
        for codec in (0, 1)
        for way in range(3)
    ),
    (POSITION, POSITION_F8, NORMAL, COLOUR),
    sources=(counters(48, 48),),
    box=(FAN_BOX[:3], FAN_BOX[3:]),
)
