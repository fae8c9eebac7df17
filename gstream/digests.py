"""What a file of ours holds, as counts and digests of its decoded values.

Two files with the same digests hold the same scene, however it was packed. Every byte is read. The
values that a digest covers: spec/conformance/README.md.
"""

import os
from collections.abc import Iterator
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.blockview import BlockView
from gstream.compiled import READING
from gstream.errors import UnsupportedError
from gstream.formats.blockhead import check_tail
from gstream.formats.directory import TAIL_BYTES
from gstream.formats.stream import StreamReader
from gstream.read import open_block_file

DIGEST_BYTES = 16
Values = NDArray[Any] | None  # None: of an unknown kind, codec or filter


class _Digests:
    """Running digests by name; one that cannot be read once has none."""

    def __init__(self) -> None:
        self._hashes: dict[str, Any] = {}

    def add(self, name: str, values: Values) -> None:
        digest = self._hashes.setdefault(name, blake2b(digest_size=DIGEST_BYTES))
        if values is None or digest is None:
            self._hashes[name] = None
        else:
            digest.update(np.ascontiguousarray(values).data)

    def hex(self) -> dict[str, str | None]:
        return {name: d.hexdigest() if d else None for name, d in sorted(self._hashes.items())}


def block_file_content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Blocks, voxels and a digest of every column, of each level that has blocks.

    errors : CorruptFileError; UnsupportedError for a newer file
    """
    with open_block_file(path, choose=READING) as file:
        tail = file.read_range(file.head.file_bytes - TAIL_BYTES, TAIL_BYTES)
        check_tail(tail, file.head, file.path)
        levels = []
        for level in range(file.levels):
            blocks, voxels, digests = 0, 0, _Digests()
            for view in file.blocks(level, file.columns):
                blocks += 1
                voxels += view.count
                for name, values in _block_values(view):
                    digests.add(name, values)
            if blocks:
                counts = {"level": level, "blocks": blocks, "voxels": voxels}
                levels.append({**counts, "columns": digests.hex()})
    return {"levels": levels}


def _block_values(view: BlockView) -> Iterator[tuple[str, Values]]:
    yield "key", np.array([view.key], "<u8")
    for name in view.file.columns:
        try:
            yield name, view.column(name)
        except UnsupportedError:
            yield name, None


def stream_content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Chunks, triangles, vertices and a digest of every attribute by its id, as level 0.

    errors : CorruptFileError; UnsupportedError for a newer file
    """
    stream = StreamReader(os.fspath(path))
    digests = _Digests()
    for index in range(len(stream.chunks)):
        values = stream.parts(index)
        for part in stream.head(index).parts:
            digests.add(str(part.attribute), values.get(part.attribute))
    if not len(stream.chunks):
        return {"levels": []}
    counts = {
        name: int(stream.chunks[name].sum(dtype=np.int64)) for name in ("triangles", "vertices")
    }
    level = {"level": 0, "chunks": len(stream.chunks), **counts}
    return {"levels": [{**level, "columns": digests.hex()}]}
