"""Good streams that use other freedoms: constants, several sources, the most of all.

Put together with struct alone, as those of stream_bytes.py.
`python -m tests.conformance.stream_freedoms spec/vectors` writes the vectors of streams that are
missing; one that is there is never written again.
"""

import json
import struct
import sys
from dataclasses import replace
from pathlib import Path

from .stream_bytes import (
    BAD,
    COLOUR,
    FAN_BOX,
    FAN_CHUNK,
    GOOD,
    NORMAL,
    POSITION,
    POSITION_F8,
    SMALLEST,
    SOUP,
    ChunkBytes,
    PartBytes,
    StreamBytes,
    counters,
    full_chunk,
)

PRIVATE = range(32_768, 32_768 + 29)  # ids for private use


def constants() -> StreamBytes:
    """Constants for all that can be one, and colours of each domain."""
    point = PartBytes(1, 0, struct.pack("<3f", 1.0, -2.0, 3.5), codec=2)
    box = (1.0, -2.0, 3.5) * 2
    point_f8 = PartBytes(2, 0, struct.pack("<3d", 1.0, -2.0, 3.5), codec=2)
    per_vertex = PartBytes(4, 0, b"\1\2\3\4", codec=2)
    chunks = (
        ChunkBytes((PartBytes(0, 1, b"\0\0", codec=2), point, per_vertex), 2, 1, 2,
                   degenerate=2, box=box),
        ChunkBytes((point, PartBytes(4, 2, b"\5\6\7\0", codec=2)), 2, 6, degenerate=2, box=box),
        ChunkBytes((PartBytes(4, 2, bytes(range(8))), point_f8), 2, 6, degenerate=2, box=box),
        ChunkBytes((point_f8, PartBytes(4, 3, b"\xff\0\xff\0")), 2, 6, degenerate=2, box=box),
    )  # fmt: skip
    return StreamBytes(
        chunks, (POSITION, POSITION_F8, COLOUR), sources=(counters(8, 8, 0, 8),),
        box=(box[:3], box[3:]),
    )  # fmt: skip


def several_sources() -> StreamBytes:
    """Three sources, one without chunks, the others in turns, and free text and counters."""
    other = {**counters(2, 1, 1), "name": "b \u00e9.obj", "skipped_faces": 3, "mine": [1, None]}
    chunks = (SOUP, replace(SOUP, source=2, non_finite=1), replace(SOUP, source=0))
    metadata = {
        "units": "mm", "up": "-y", "crs": "EPSG:25832", "bounds": [0, 0, 0, 1e3, 2.5, -0.0],
        "mine": {"deep": [[], {}]},
    }  # fmt: skip
    return replace(
        SMALLEST, chunks=chunks, sources=(counters(2, 2), counters(0, 0), other),
        metadata=json.dumps(metadata, ensure_ascii=False).encode(),
    )  # fmt: skip


def most_parts() -> StreamBytes:
    """32 descriptors, and 32 parts in the chunk: indices, positions and what is private."""
    names = (f"p{id_} ".ljust(24, "x").encode() for id_ in PRIVATE)
    own = tuple((id_, 1, 1, name) for id_, name in zip(PRIVATE, names, strict=True))
    parts = (*FAN_CHUNK.parts[:3], *(PartBytes(id_, 0, b"%d" % id_) for id_ in PRIVATE))
    return StreamBytes(
        (replace(FAN_CHUNK, parts=parts),), (POSITION, NORMAL, *own, COLOUR), b'{"up":null}',
        (counters(6, 4, 2, 1),), (FAN_BOX[:3], FAN_BOX[3:]),
    )  # fmt: skip


FREEDOMS: dict[str, StreamBytes] = {
    "stream-full-chunk": full_chunk(1, 0, 1),  # the 0 is vertex 0, the mark being 65 536
    "stream-constants": constants(),
    "stream-several-sources": several_sources(),
    "stream-most-parts": most_parts(),
}


def write_missing(folder: Path) -> None:
    """Write the vectors that are not there."""
    good = {name: stream.write() for name, stream in (GOOD | FREEDOMS).items()}
    for kind, table in (("good", good), ("bad", BAD)):
        for name, data in table.items():
            path = folder / kind / f"{name}.gst"
            if not path.exists():
                path.write_bytes(data)


if __name__ == "__main__":
    write_missing(Path(sys.argv[1]))
