"""Sound block files that are seldom: the most of all that is limited, and rare settings."""

from zlib import crc32

import numpy as np
from small_block_files import IDENTITY, Scene, file_bytes, random_scene

from gstream.formats.blockhead import BlockFileHeader
from gstream.formats.columns import Block, ColumnSpec, EncodedColumn, hash64
from gstream.formats.morton import encode_morton

Encoded = dict[str, EncodedColumn]
META_BYTES = 12_288
SHEAR = (0.5, 0.25, 0.0, -1e6, 0.0, -0.5, 0.0, 2e6, 0.125, 0.0, 2.0, 3.0)


def with_empty_blocks(levels: int) -> bytes:
    """A block that is stated to be empty, and its ancestors below a block with voxels likewise."""
    scene = random_scene(resolution=32, voxels=9, seed=6 if levels == 1 else 0)
    level = levels - 1
    here = {key for at, key in scene.blocks if at == level}
    parents = {key for at, key in scene.blocks if at == levels}
    top = next(k for k in range(64) if k not in here and k >> 3 in parents)

    def alter(rows: np.ndarray) -> np.ndarray:
        empty = np.zeros(levels, rows.dtype)
        empty["level"] = np.arange(levels)
        empty["key"] = [top << 3 * (level - at) for at in range(levels)]
        empty["children"] = empty["level"] > 0  # each has its first child
        parent = (rows["level"] == levels) & (rows["key"] == top >> 3)
        rows["children"][parent] |= 1 << (top & 7)
        return np.concatenate([rows, empty])

    return file_bytes(scene, alter_rows=alter)


def other_settings() -> bytes:
    """The settings that no other vector has, a sheared grid, and values at their limits."""
    codes = np.arange(8, dtype=np.uint32)
    normal = np.array([[4095, 4095], [0, 2047], [4094, 2047]] + [[2047, 2047]] * 5, np.uint16)
    weight = np.array([1, 2**32 - 1] * 4, np.uint32)
    block = Block(codes, 1 + codes.astype(np.uint8), normal, np.zeros((8, 4), np.uint8), weight)
    flat = (-1.0, -2.0, -3.0, -1.0, 2.0, 3.0)
    header = BlockFileHeader(
        8, 0, 1, 3, SHEAR, flat, "conservative", "closed", "both", "input", "count", 12
    )
    return file_bytes(Scene(header, {(0, 0): block}))


def full_block(log2: int, names: tuple[str, ...]) -> bytes:
    """Every voxel of one block; masks are those of its sides, all else is constant."""
    edge = 1 << log2
    count = edge**3
    codes = np.arange(count, dtype=np.uint32)
    mask = np.full(count, 63, np.uint8)
    if log2 < 8:
        mask[codes & 0b111_000 == 0] = 1
    wide = float(edge)
    header = BlockFileHeader(
        edge, 16, 1, log2, IDENTITY, (0.0, 0.0, 0.0, wide, wide, wide), "26", lod_weighting="count"
    )
    block = Block(
        codes, mask, np.full((count, 2), 1023, np.uint16), np.full((count, 4), 200, np.uint8),
    )  # fmt: skip
    return file_bytes(Scene(header, {(0, 0): block}, names))


def last_voxel(resolution: int, levels: int) -> bytes:
    """The last voxel of the grid, at every level."""
    header = BlockFileHeader(
        resolution, 10, levels, 3, IDENTITY, (0.0,) * 3 + (float(resolution),) * 3
    )
    blocks = {}
    for level in range(levels):
        place = np.full((1, 3), (resolution - 1) >> level)
        code = int(encode_morton(place)[0])
        local = np.array([code & 511], np.uint32)
        blocks[level, code >> 9] = Block(local, np.array([63], np.uint8))
    return file_bytes(Scene(header, blocks, ("occupancy", "mask")))


def most_tables() -> bytes:
    """16 columns, 11 of them of later versions, 16 sections and 12 288 bytes of metadata."""
    scene = random_scene(resolution=16, voxels=23, seed=5)
    own = [ColumnSpec(80 + i, f"column é {i}".ljust(23, "_"), 9, 33, 4, ()) for i in range(11)]

    def alter(_: int, __: int, encoded: Encoded) -> None:
        for i, spec in enumerate(own):
            data = b"%d" % i
            crc = crc32(data)
            encoded[spec.name] = EncodedColumn(data, 1 + i, crc, 7, 200 + i, 100 + i, hash64(data))

    names = [b"sec%x" % i for i in range(12)]
    sections = [(name, name * i) for i, name in enumerate(names)]
    meta = {"crs": 'PROJCRS["é", "\n"]', "up": None, "mine": [1.5, {"a": [True, None]}], "text": ""}
    short = file_bytes(scene, meta=meta, alter=alter, extra=sections, more=own)
    text = "x" * (META_BYTES - meta_bytes_of(short))
    return file_bytes(scene, meta=meta | {"text": text}, alter=alter, extra=sections, more=own)


def meta_bytes_of(data: bytes) -> int:
    """Length of the META section."""
    return int.from_bytes(data[256 + 3 * 32 + 16 : 256 + 3 * 32 + 24], "little")


def scattered(count: int, step: int) -> Scene:
    """As many blocks of one voxel, whose keys are multiples of `step`; one level."""
    codes = np.arange(count, dtype=np.uint64) * np.uint64(step)
    header = BlockFileHeader(1024, 12, 1, 3, IDENTITY, (0.0,) * 3 + (1024.0,) * 3)
    one = np.array([63], np.uint8)
    blocks = {(0, int(c)): Block(np.array([c % 512], np.uint32), one) for c in codes}
    return Scene(header, blocks, ("occupancy", "mask"))
