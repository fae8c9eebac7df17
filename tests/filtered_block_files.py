"""A block file in which every column stands by every codec and filter that it may have."""

from zlib import crc32

import numpy as np
from small_block_files import ALL, IDENTITY, Scene, file_bytes

from gstream.formats import filters
from gstream.formats.blockhead import BlockFileHeader
from gstream.formats.columns import Block, EncodedColumn, column_specs, column_values
from gstream.formats.framing import CODEC_CONSTANT, CODEC_LZ4, CODEC_RAW, compress
from gstream.formats.lodrule import encode_normals
from gstream.formats.morton import decode_morton, encode_morton

BITS, LOG2, EDGE = 11, 4, 3  # of normals, of a block's edge; blocks along an axis
COLUMNS = (*ALL, "label", "spread")
WAYS = [(codec, filter_) for codec in (CODEC_RAW, CODEC_LZ4) for filter_ in range(6)]


def _sheet(seed: int) -> Block:
    """125 voxels of a sheet, so that bit planes end within a byte; LZ4 shrinks every column."""
    x, y = np.meshgrid(np.arange(16), np.arange(8))
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, seed)], axis=1)[:125]
    morton = np.sort(encode_morton(places)).astype(np.uint32)
    ramp = np.arange(morton.size)
    slope = np.stack([100 + ramp // 25, 50 - ramp // 25, 900 - ramp // 50], axis=1)
    colour = np.stack([40 + ramp // 9, 200 - ramp // 9, ramp // 30, 255 - ramp // 60], axis=1)
    jump = (ramp // 40 % 2).astype(np.uint32)  # the difference of neighbours wraps
    return Block(
        morton,
        (1 + (ramp // 16 + seed) % 63).astype(np.uint8),
        encode_normals(slope - 90 * seed, BITS),
        (colour + 16 * seed & 255).astype(np.uint8),
        (70_000 * seed + 1 + ramp // 6).astype(np.uint32),
        jump * np.uint32(0xFFFFFFFF) ^ np.uint32(seed),
        (ramp // 11 * 23 & 255).astype(np.uint8),
    )


def _single() -> Block:
    """One voxel, of which every column but occupancy is a constant."""
    sheet = _sheet(13)
    return Block(*(getattr(sheet, name)[99:100] for name in ("morton", *COLUMNS[1:])))


def every_filter() -> bytes:
    """Twelve blocks, one for each of WAYS, and one of constants."""
    keys = [key for key in range(64) if (decode_morton(np.array([key], "u8")) < EDGE).all()]
    blocks = dict(zip(keys, [*map(_sheet, range(len(WAYS))), _single()], strict=False))
    ways = dict(zip(blocks, [*WAYS, (CODEC_CONSTANT, 0)], strict=True))

    def stored(name: str, key: int, found: EncodedColumn) -> EncodedColumn:
        codec, filter_ = ways[key]
        if codec == CODEC_CONSTANT:
            return found
        if name == "occupancy":
            filter_, data = 0, filters.encode_occupancy(blocks[key].morton, LOG2)
        else:
            filter_ = filter_ if filter_ < 5 or name == "colour" else filters.BIT_PLANES
            spec = column_specs(BITS)[name]
            data = filters.apply_filter(filter_, column_values(blocks[key], spec), spec.bits)
        kept = compress(data.data, "fast") if codec == CODEC_LZ4 else data.tobytes()
        return EncodedColumn(kept, found.raw_bytes, crc32(kept), 0, codec, filter_, found.hash64)

    def alter(level: int, key: int, encoded: dict[str, EncodedColumn]) -> None:
        encoded.update({name: stored(name, key, found) for name, found in encoded.items()})

    header = BlockFileHeader(
        EDGE << LOG2, 12, 1, LOG2, IDENTITY, (0.0,) * 3 + (float(EDGE << LOG2),) * 3,
        normal_bits=BITS,
    )  # fmt: skip
    scene = Scene(header, {(0, key): block for key, block in blocks.items()}, COLUMNS)
    return file_bytes(scene, alter=alter)
