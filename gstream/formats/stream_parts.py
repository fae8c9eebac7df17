"""Packing and unpacking one chunk of a geometry stream.

spec/stream.md, "Parts". The head and its records are in stream_chunk.py.
"""

from collections.abc import Iterator, Set
from struct import Struct
from typing import Final

import numpy as np

from gstream.errors import CorruptFileError
from gstream.formats import stream_filters
from gstream.formats.framing import (
    CODEC_CONSTANT,
    CODEC_LZ4,
    CODEC_RAW,
    compress,
    crc32,
    decompress,
)
from gstream.formats.stream_chunk import (
    COLOUR,
    DOMAIN_CORNER,
    DOMAIN_VERTEX,
    DOMAINS,
    DTYPES,
    INDEX,
    KNOWN,
    NORMAL,
    POSITION_F4,
    POSITION_F8,
    Array,
    Attribute,
    Chunk,
    ChunkHead,
    Part,
    Place,
)
from gstream.formats.stream_filters import (
    FILTER_CORNER_DELTA,
    FILTER_DELTA,
    FILTER_EDGES,
    FILTER_FIRST_USE,
    FILTER_NONE,
    FILTER_ORDERED_CORNER_DELTA,
    FILTER_ORDERED_DELTA,
    Filters,
    rows_before,
)

BOX: Final = Struct("<6d")
WORTH_PACKING: Final = 64  # bytes; LZ4 keeps the last 12 as they are
CODECS: Final = (CODEC_RAW, CODEC_LZ4, CODEC_CONSTANT)
CORNER_FILTERS: Final = (FILTER_CORNER_DELTA, FILTER_ORDERED_CORNER_DELTA)
INDEX_FILTERS: Final = (FILTER_NONE, FILTER_FIRST_USE, FILTER_EDGES)
INTEGER_FILTERS: Final = (FILTER_NONE, FILTER_DELTA, FILTER_CORNER_DELTA)
FLOAT_FILTERS: Final = (FILTER_NONE, FILTER_ORDERED_DELTA, FILTER_ORDERED_CORNER_DELTA)


def encode_chunk(chunk: Chunk, lz4: str, filters: Filters = stream_filters) -> bytes:
    """Head and payload of one chunk; lz4: fast | hc."""
    payload: list[bytes] = []
    parts: list[Part] = []
    bases: Array | None = None
    if chunk.triangles is not None:
        bases = np.empty(len(chunk.positions), np.int32)
        filters.corner_bases(chunk.triangles, bases)
    for attribute, domain, values in _values(chunk):
        near = bases if domain == DOMAIN_VERTEX else None
        part, stored = _encode_part(attribute, domain, values, near, lz4, filters)
        parts.append(part)
        payload.append(stored)
    head = ChunkHead(
        index_bytes=0 if chunk.triangles is None else 2,
        triangles=chunk.triangle_count,
        vertices=len(chunk.positions),
        source=chunk.source,
        payload=sum(map(len, payload)),
        non_finite=chunk.non_finite,
        degenerate=chunk.degenerate,
        box=tight_box(chunk.positions),
        parts=tuple(parts),
    )
    return b"".join([head.write(), *payload])


def tight_box(positions: Array) -> tuple[float, ...]:
    """Low x y z and high x y z as float64; zeros for no vertices, and a zero is always +0.0."""
    if not len(positions):
        return (0.0,) * 6
    columns = np.ascontiguousarray(
        positions.T
    )  # min over a long axis is vectorised: 8 times faster
    low, high = columns.min(axis=1), columns.max(axis=1)
    return tuple(float(value) + 0.0 for value in (*low, *high))


def position_attribute(positions: Array) -> Attribute:
    return POSITION_F8 if positions.dtype == np.float64 else POSITION_F4


def _values(chunk: Chunk) -> Iterator[tuple[Attribute, int, Array]]:
    if chunk.triangles is not None:
        yield INDEX, DOMAIN_CORNER, chunk.triangles.reshape(-1, 1)
    yield position_attribute(chunk.positions), DOMAIN_VERTEX, chunk.positions
    if chunk.normals is not None:
        yield NORMAL, DOMAIN_VERTEX, chunk.normals
    if chunk.colours is not None:
        yield COLOUR, chunk.colour_domain, chunk.colours


def _encode_part(
    attribute: Attribute,
    domain: int,
    values: Array,
    bases: Array | None,
    lz4: str,
    filters: Filters,
) -> tuple[Part, bytes]:
    values = np.ascontiguousarray(values, DTYPES[attribute.dtype])
    bits = values.view(f"<u{values.itemsize}")
    filter_, codec, stored, raw = FILTER_NONE, CODEC_RAW, b"", values.nbytes
    if attribute is not INDEX and _constant(bits):
        codec, stored = CODEC_CONSTANT, bits[0].tobytes()
        raw = len(stored)
    elif raw >= WORTH_PACKING:
        filter_, planes = _filtered(attribute, bits, bases, filters)
        codec, stored, raw = CODEC_LZ4, compress(planes.data, lz4), planes.nbytes
    if codec == CODEC_RAW or (codec == CODEC_LZ4 and len(stored) >= values.nbytes):
        filter_, codec, stored, raw = FILTER_NONE, CODEC_RAW, values.tobytes(), values.nbytes
    return Part(attribute.id, domain, filter_, codec, len(stored), raw, crc32(stored)), stored


def _constant(bits: Array) -> bool:
    return len(bits) > 1 and bool((bits[1] == bits[0]).all() and (bits == bits[0]).all())


def _filtered(
    attribute: Attribute, bits: Array, bases: Array | None, filters: Filters
) -> tuple[int, Array]:
    if attribute is INDEX:
        codes, extra = np.empty(len(bits) // 3, np.uint8), np.empty(len(bits), np.uint16)
        used = filters.edge_codes(bits.reshape(-1, 3), codes, extra)
        if used >= 0:
            halves = extra[:used].astype("<u2").view(np.uint8).reshape(-1, 2)
            return FILTER_EDGES, np.concatenate([codes, halves[:, 0], halves[:, 1]])
    planes = np.empty((bits.shape[1], bits.itemsize, len(bits)), np.uint8)
    if attribute is INDEX:
        filters.first_use_planes(bits[:, 0], planes[0])
        return FILTER_FIRST_USE, planes
    ordered = DTYPES[attribute.dtype][1] == "f"
    if bases is None:
        filters.delta_planes(bits, rows_before(len(bits)), ordered, planes)
        return (FILTER_ORDERED_DELTA if ordered else FILTER_DELTA), planes
    filters.delta_planes(bits, bases, ordered, planes)
    return (FILTER_ORDERED_CORNER_DELTA if ordered else FILTER_CORNER_DELTA), planes


def decode_chunk(
    data: bytes,
    path: str,
    at: int,
    wanted: frozenset[str] = frozenset({"normal", "colour"}),
    filters: Filters = stream_filters,
) -> Chunk:
    """Unpack the chunk in `data`, which lies at byte `at` of `path`; what is not wanted is None.

    errors: CorruptFileError; UnsupportedError for an unknown filter or codec of what is wanted
    """
    names = wanted | {"index", "position"}
    ids = {attribute.id for attribute in KNOWN.values() if attribute.name in names}
    head, found = decode_parts(data, path, at, ids, filters)
    domains = {part.attribute: part.domain for part in head.parts}
    index = found.get(INDEX.id)
    return Chunk(
        positions=found[POSITION_F4.id if POSITION_F4.id in found else POSITION_F8.id],
        triangles=None if index is None else index.reshape(-1, 3),
        normals=found.get(NORMAL.id),
        colours=found.get(COLOUR.id),
        colour_domain=domains.get(COLOUR.id, DOMAIN_VERTEX),
        source=head.source,
        non_finite=head.non_finite,
        degenerate=head.degenerate,
    )


def decode_parts(
    data: bytes, path: str, at: int, wanted: Set[int] | None, filters: Filters = stream_filters
) -> tuple[ChunkHead, dict[int, Array]]:
    """The head of a chunk, and the (n, components) values of its parts by attribute.

    wanted : ids of attributes; None: all that this version knows, and the CRC of the others
    errors: CorruptFileError; UnsupportedError for an unknown filter or codec of what is wanted
    """
    head = ChunkHead.read(data, path, at)
    if len(data) != head.size + head.payload:
        raise CorruptFileError("GST-0105", path, at, "the chunk is not as long as its head says")
    skipped = unreadable(head) if wanted is None else {}
    found: dict[int, Array] = {}
    offset = head.size
    for part in head.parts:
        where = Place(path, at + offset)
        stored = memoryview(data)[offset : offset + part.stored]
        offset += part.stored
        if wanted is None or part.attribute in wanted:
            if crc32(stored) != part.crc:
                raise where.corrupt("GST-0111", f"the CRC of attribute {part.attribute} is wrong")
            if part.attribute not in skipped:
                index = found.get(INDEX.id)
                found[part.attribute] = decode_part(head, part, stored, index, where, filters)
    positions = found.get(POSITION_F4.id, found.get(POSITION_F8.id))
    if positions is not None and BOX.pack(*tight_box(positions)) != BOX.pack(*head.box):
        said = "the box is not the tight box of the vertices"  # so it is when one is NaN
        raise CorruptFileError("GST-0117", path, at + 32, said)
    return head, found


def unreadable(head: ChunkHead) -> dict[int, str]:
    """What this version does not know of the parts that it cannot read, by attribute."""
    found = {part.attribute: said for part in head.parts if (said := _unknown(part))}
    if INDEX.id in found:
        led = {part.attribute for part in head.parts if part.filter in CORNER_FILTERS}
        found = {attribute: "indices" for attribute in led} | found
    return found


def _unknown(part: Part) -> str | None:
    """What this version does not know of a part, if there is anything."""
    attribute = KNOWN.get(part.attribute)
    if attribute is None:
        return "kind"
    is_float = DTYPES[attribute.dtype][1] == "f"
    filters = FLOAT_FILTERS if is_float else INTEGER_FILTERS
    for what, number, known in (
        ("domain", part.domain, DOMAINS[attribute.name]),
        ("codec", part.codec, CODECS),
        ("filter", part.filter, INDEX_FILTERS if attribute is INDEX else filters),
    ):
        if number not in known:
            return f"{what} {number}"
    return None


def decode_part(
    head: ChunkHead,
    part: Part,
    stored: memoryview,
    index: Array | None,
    where: Place,
    filters: Filters = stream_filters,
) -> Array:
    """The (n, components) values of one part; index: those of the chunk, where it has any."""
    attribute = KNOWN[part.attribute]
    if said := _unknown(part):
        raise where.unsupported(f"{said} of attribute {attribute.name}")
    count = (head.vertices, 3 * head.triangles, head.triangles, 1)[part.domain]
    dtype = np.dtype(DTYPES[attribute.dtype])
    raw = attribute.value_bytes * (1 if part.codec == CODEC_CONSTANT else count)
    if part.filter == FILTER_EDGES and 0 <= part.raw - head.triangles <= raw:
        raw = part.raw - (part.raw - head.triangles) % 2  # one byte per triangle, and pairs
    if part.raw != raw:
        said = f"a {attribute.name} part states {part.raw} bytes where {raw} are needed"
        raise where.corrupt("GST-0107", said)
    data = _unpack(part, stored, where)
    values = np.empty((count, attribute.components), dtype)
    bits = values.view(f"<u{dtype.itemsize}")
    if part.filter == FILTER_NONE:
        values[:] = np.frombuffer(data, dtype).reshape(-1, attribute.components)
    elif attribute is INDEX:
        _undo_index(part, np.frombuffer(data, np.uint8), bits[:, 0], head, where, filters)
    else:
        planes = np.frombuffer(data, np.uint8).reshape(attribute.components, dtype.itemsize, count)
        _undo_delta(part, planes, bits, index, where, filters)
    if attribute is INDEX and count and int(values.max()) >= head.vertices:
        said = f"vertex {int(values.max())} of {head.vertices} is named"
        raise where.corrupt("GST-0112", said)
    return values


def _unpack(part: Part, stored: memoryview, where: Place) -> bytes | memoryview:
    if part.codec == CODEC_LZ4:
        return decompress(stored, part.raw, "GST-0113", where.path, where.at)
    if part.stored != part.raw or (part.codec == CODEC_CONSTANT and part.filter != FILTER_NONE):
        raise where.corrupt("GST-0107", "a part that is not packed has another length")
    return stored


def _undo_index(
    part: Part, data: Array, indices: Array, head: ChunkHead, where: Place, filters: Filters
) -> None:
    if part.filter == FILTER_EDGES:
        codes, halves = data[: head.triangles], data[head.triangles :].reshape(2, -1)
        extra = halves[0].astype(np.uint16) | halves[1].astype(np.uint16) << 8
        used = filters.undo_edge_codes(codes, extra, head.vertices, indices)
    else:
        used = filters.undo_first_use_planes(data.reshape(2, -1), head.vertices, indices)
    if used != head.vertices:
        said = (
            f"the indices use {used} of {head.vertices} vertices" if used >= 0 else "a broken index"
        )
        raise where.corrupt("GST-0114", said)


def _undo_delta(
    part: Part, planes: Array, bits: Array, index: Array | None, where: Place, filters: Filters
) -> None:
    near = part.filter in CORNER_FILTERS
    bases = rows_before(len(bits))
    if near:
        if index is None or part.domain != DOMAIN_VERTEX:
            raise where.corrupt("GST-0107", "a corner delta without indices")
        filters.corner_bases(index.reshape(-1, 3), bases)
    ordered = part.filter in (FILTER_ORDERED_DELTA, FILTER_ORDERED_CORNER_DELTA)
    filters.undo_delta_planes(planes, bases, ordered, bits)


def warm_filters(filters: Filters, *, packing: bool = True) -> None:
    """Pack and unpack small chunks of every kind, so that compiled filters are compiled.

    packing : False where chunks are only read: packing is then done by the plain filters
    """
    corners = np.arange(192, dtype=np.uint16)
    strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    strip[1::2] = strip[1::2, [1, 0, 2]]
    colours = np.zeros((192, 4), np.uint8)
    colours[0] = 1
    for dtype in (np.float32, np.float64):
        points = np.zeros((192, 3), dtype)
        points[0] = 1
        for triangles in (None, corners.reshape(-1, 3), strip):
            chunk = Chunk(points, triangles, points.astype(np.float32), colours)
            packed = encode_chunk(chunk, "fast", filters if packing else stream_filters)
            decode_chunk(packed, "", 0, filters=filters)
