"""Small block files with source triangles: sound ones, and one for each way to be wrong."""

from dataclasses import replace
from itertools import product
from typing import Any
from zlib import crc32

import numpy as np
from small_block_files import Scene, file_bytes, random_scene

from gstream.formats import filters
from gstream.formats.columns import EncodedColumn, hash64, raw_form
from gstream.formats.framing import CODEC_LZ4, CODEC_RAW, compress
from gstream.formats.pieces import NO_ITEMS, Pieces, encode_pieces, piece_specs

Encoded = dict[str, EncodedColumn]
RECIPES = [*product(filters.FILTERS[:5], (CODEC_RAW, CODEC_LZ4))]


def scene() -> Scene:
    return random_scene(resolution=16, voxels=23, seed=5, names=("occupancy", "mask"))


def some_pieces(key: int, edge: int) -> Pieces:
    """A strip of triangles over a few vertices, on the borders of the block among them."""
    rng = np.random.default_rng(key)
    count = 3 + 5 * (key % 3)
    inner = rng.integers(1, edge, (count - 2, 3))
    vertices = np.concatenate([[[0, 0, 0]], inner, [[edge, edge, edge]]]).astype(np.uint32)
    numbers = np.arange(count - 2, dtype=np.uint32)[:, None] + np.arange(3, dtype=np.uint32)
    return Pieces(vertices, numbers)


def with_pieces(changes: dict[int, Any] | None = None, ledger: dict[str, int] | None = None):
    """A block file whose finest blocks have pieces; not the block of key 1.

    changes : what the pieces of a block, or the columns of one, are instead: by key, -1 the root's
    """
    made = scene()
    header, stored = made.header, 0
    edge = 1 << (header.block_log2 + header.snap_bits)
    specs = piece_specs(header.vertex_bits)

    def alter(level: int, key: int, encoded: Encoded) -> None:
        nonlocal stored
        change = (changes or {}).get(key if level == 0 else -1)
        pieces = some_pieces(key, edge) if level == 0 and key != 1 else None
        if isinstance(change, Pieces):
            pieces = change
        if pieces:
            encoded |= encode_pieces(pieces, header.vertex_bits, "fast")
            stored += len(pieces.triangles)
        else:
            encoded |= {name: NO_ITEMS for name in specs}
        if isinstance(change, dict):
            encoded |= change

    pile = {"alter": alter, "more": tuple(specs.values())}
    if ledger is None:
        file_bytes(made, **pile)  # counts them
        ledger = {"pieces": stored, "pieces_left_out": 0}
    return file_bytes(replace(made, ledger=ledger), **pile)


def recoded(pieces: Pieces, bits: int, recipe: tuple[int, int]) -> Encoded:
    """Both columns by one filter and codec."""
    filter_id, codec = recipe
    columns = {}
    for spec, values in zip(piece_specs(bits).values(), pieces, strict=True):
        data = filters.apply_filter(filter_id, values, spec.bits).tobytes()
        if codec == CODEC_LZ4:
            data = compress(data, "fast")
        raw = raw_form(values)
        columns[spec.name] = EncodedColumn(
            data, raw.nbytes, crc32(data), 0, codec, filter_id, hash64(raw.tobytes())
        )
    return columns


def every_filter() -> bytes:
    """One block for each filter and codec that the columns may have."""
    made = random_scene(resolution=32, voxels=60, seed=1, names=("occupancy", "mask"))
    header = made.header
    edge = 1 << (header.block_log2 + header.snap_bits)
    keys = [key for level, key in made.blocks if level == 0]

    def alter(level: int, key: int, encoded: Encoded) -> None:
        encoded |= {"vertex": NO_ITEMS, "triangle": NO_ITEMS}
        if level == 0 and keys.index(key) < len(RECIPES):
            recipe = RECIPES[keys.index(key)]
            encoded |= recoded(some_pieces(key, edge), header.vertex_bits, recipe)

    return file_bytes(made, alter=alter, more=tuple(piece_specs(header.vertex_bits).values()))


def first_triangle(**fields: Any) -> bytes:
    """A file in which the triangles of one block are other bytes."""
    edge = 1 << 15
    column = encode_pieces(some_pieces(0, edge), 16, "fast")["triangle"]
    return with_pieces({0: {"triangle": replace(column, **fields)}})


def wrong(vertices: Any, triangles: Any, key: int = 0) -> bytes:
    """A file with these pieces in one block."""
    return with_pieces({key: Pieces(np.array(vertices, np.uint32), np.array(triangles, np.uint32))})


def lone_column() -> bytes:
    made = scene()
    spec = piece_specs(made.header.vertex_bits)["vertex"]

    def alter(level: int, key: int, encoded: Encoded) -> None:
        encoded["vertex"] = NO_ITEMS

    return file_bytes(made, alter=alter, more=(spec,))


TRIANGLE = [[0, 0, 0], [9, 0, 0], [0, 9, 1 << 15]]
GOOD = {
    "blocks-pieces": with_pieces,
    "blocks-pieces-every-filter": every_filter,
}
DAMAGE = {
    "GSB-0402-pieces": lambda: first_triangle(raw_bytes=13),
    "GSB-0402-no-pieces": lambda: with_pieces({1: {"vertex": replace(NO_ITEMS, raw_bytes=12)}}),
    "GSB-0403-pieces": lambda: with_pieces({1: {"vertex": replace(NO_ITEMS, constant=1)}}),
    "GSB-0413": lambda: wrong(TRIANGLE, [[0, 1, 3]]),
    "GSB-0413-no-vertices": lambda: with_pieces({0: {"vertex": NO_ITEMS}}),
    "GSB-0414": lambda: wrong([[0, 0, 0], [9, 0, 0], [0, 9, (1 << 15) + 1]], [[0, 1, 2]]),
    "GSB-0414-above-level-0": lambda: wrong(TRIANGLE, [[0, 1, 2]], key=-1),
    "GSB-0414-one-column": lone_column,
    "GSB-0414-same-vertices": lambda: wrong([*TRIANGLE, [9, 0, 0]], [[0, 1, 2], [0, 2, 3]]),
    "GSB-0414-two-corners": lambda: wrong(TRIANGLE, [[0, 1, 2], [1, 1, 2]]),
    "GSB-0414-unused-vertex": lambda: wrong([*TRIANGLE, [5, 5, 5]], [[0, 1, 2]]),
    "GSB-0604": lambda: with_pieces(ledger={"pieces": 3, "pieces_left_out": 0}),
}  # fmt: skip
