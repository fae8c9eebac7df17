"""What a file of ours says of itself, as JSON values: from its head and directories alone.

Digests of what it holds are gstream/digests.py's, which reads everything.
"""

import os
from typing import Any

from gstream.digests import block_file_content, stream_content
from gstream.errors import CorruptFileError, InputError, UsageError
from gstream.formats.framing import BLOCK_MAGIC, STREAM_MAGIC
from gstream.formats.stream import StreamReader
from gstream.formats.stream_check import is_source
from gstream.read import open_block_file
from gstream.source import is_url

LEDGER = ("read", "non_finite", "degenerate")  # of a stream, in the order they are shown


def kind_of(path: str) -> str:
    """`block file` or `geometry stream`, by the magic; behind a URL, a block file.

    errors : UsageError for a path that cannot be read, InputError for another file
    """
    if is_url(path):
        return "block file"
    try:
        with open(path, "rb") as file:
            magic = file.read(len(BLOCK_MAGIC))
    except OSError as error:
        said = f"{path}: cannot be read: {os.strerror(error.errno or 0)}"
        raise UsageError(said, "check its name and permissions") from error
    if magic == BLOCK_MAGIC:
        return "block file"
    if magic == STREAM_MAGIC:
        return "geometry stream"
    remedy = "name a .gst or .gsb file that gstream wrote"
    raise InputError(path, "byte 0", "neither a block file nor a geometry stream", remedy)


def facts(path: str, digests: bool = False) -> dict[str, Any]:
    """Header, levels, columns, metadata and ledger of a block file; the like of a stream.

    digests : add `content`, for which all of the file is read (spec/conformance/README.md)
    """
    is_stream = kind_of(path) == "geometry stream"
    held = _stream(path) if is_stream else _block_file(path)
    if digests:
        held["content"] = stream_content(path) if is_stream else block_file_content(path)
    return held


def _block_file(path: str) -> dict[str, Any]:
    with open_block_file(path) as scene:
        settings, rows = scene.header, scene.head.levels
        levels = [
            {
                "level": number,
                "blocks": int(row["blocks"]),
                "voxels": int(row["voxels"]),
                "block_edge": 1 << int(row["block_log2"]),
            }
            for number, row in enumerate(rows)
        ]
        metadata = dict(scene.metadata)
        size = scene.head.file_bytes
        columns = [
            {"id": c.id, "name": c.name, "components": c.components, "bits": c.bits}
            for c in scene.head.columns
        ]
        content_id, matrix = scene.content_id, list(settings.matrix)
    finest = levels[0]["voxels"]
    return {
        "kind": "block file",
        "path": path,
        "bytes": size,
        "bytes_per_voxel": size / finest if finest else None,
        "content_id": content_id,
        "resolution": settings.resolution,
        "voxel_size": matrix[0],
        "matrix": matrix,
        "box": list(settings.box),
        "snap_bits": settings.snap_bits,
        "sep": settings.sep,
        "ties": settings.ties,
        "faces": settings.faces,
        "normals": settings.normals,
        "normal_bits": settings.normal_bits,
        "lod_weighting": settings.lod_weighting,
        "blocks": sum(level["blocks"] for level in levels),
        "voxels": sum(level["voxels"] for level in levels),
        "levels": levels,
        "columns": columns,
        "ledger": metadata.pop("ledger", {}),
        "metadata": metadata,
    }


def _stream(path: str) -> dict[str, Any]:
    stream = StreamReader(path)
    sources = stream.totals.get("sources")
    if not isinstance(sources, list) or not all(map(is_source, sources)):
        said = "the totals have no list of sources and counters"
        raise CorruptFileError("GST-0209", path, stream.file_length, said)
    triangles = int(stream.chunks["triangles"].sum(dtype="int64"))
    return {
        "kind": "geometry stream",
        "path": path,
        "bytes": stream.file_length,
        "bytes_per_triangle": stream.file_length / triangles if triangles else None,
        "triangles": triangles,
        "vertices": int(stream.chunks["vertices"].sum(dtype="int64")),
        "chunks": len(stream.chunks),
        "box": None if stream.box is None else [c for corner in stream.box for c in corner],
        "attributes": [a.name for a in stream.attributes],
        "ledger": {name: sum(s[name] for s in sources) for name in LEDGER},
        "sources": sources,
        "metadata": dict(stream.metadata),
    }
