"""Small block files for tests: random voxels, their levels by the LOD rule, and the file."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gstream.formats.blockfile import DEFAULT_PAGING, Paging, write_block_file
from gstream.formats.blockhead import BlockFileHeader
from gstream.formats.columns import Block, ColumnSpec, EncodedColumn, column_specs, encode_block
from gstream.formats.directory import Rows
from gstream.formats.lodrule import encode_normals, reduce_runs
from gstream.formats.morton import decode_morton, encode_morton
from gstream.formats.pile import PileWriter, read_pile_rows

Alter = Callable[[int, int, dict[str, EncodedColumn]], None]
ALL = ("occupancy", "mask", "normal", "colour", "weight")
IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass
class Scene:
    """Blocks of every level by (level, key), and the header that goes with them."""

    header: BlockFileHeader
    blocks: dict[tuple[int, int], Block]
    names: tuple[str, ...] = ALL
    ledger: dict[str, Any] = field(default_factory=dict)

    @property
    def log2(self) -> int:
        return self.header.block_log2


def random_scene(
    resolution: int = 32,
    log2: int = 3,
    voxels: int = 300,
    seed: int = 0,
    names: Sequence[str] = ALL,
    weighting: str = "area",
    bits: int = 11,
    lod: bool = True,
) -> Scene:
    """A scene of `voxels` random voxels, with all its levels unless lod is False."""
    rng = np.random.default_rng(seed)
    places = np.unique(rng.integers(0, resolution, (voxels, 3)), axis=0)
    codes = np.sort(encode_morton(places))
    n = len(codes)
    finest = {
        "mask": rng.integers(1, 64, n).astype(np.uint8),
        "normal": encode_normals(rng.integers(-1000, 1000, (n, 3)), bits),
        "colour": rng.integers(0, 256, (n, 4)).astype(np.uint8),
        "weight": rng.integers(1, 3_000_000, n).astype(np.uint32),
    }
    levels = 1 + (-(-resolution // (1 << log2)) - 1).bit_length() if lod else 1
    header = BlockFileHeader(
        resolution, 12, levels, log2, IDENTITY, (0.0,) * 3 + (float(resolution),) * 3,
        lod_weighting=weighting, normal_bits=bits,
    )  # fmt: skip
    scene = Scene(header, {}, tuple(names))
    blocks = {}
    owner = codes >> np.uint64(3 * log2)
    for key in np.unique(owner):
        here = owner == key
        local = (codes[here] & np.uint64(8**log2 - 1)).astype(np.uint32)
        blocks[int(key)] = Block(local, **{k: v[here] for k, v in finest.items()})
    for level in range(levels):
        scene.blocks.update({(level, key): block for key, block in blocks.items()})
        blocks = coarser(blocks, log2, bits, weighting == "area")
    return scene


def coarser(blocks: dict[int, Block], log2: int, bits: int, area: bool) -> dict[int, Block]:
    """The blocks of the next level."""
    merged = {}
    for parent in sorted({key >> 3 for key in blocks}):
        group = [blocks.get(8 * parent + c) for c in range(8)]
        there = [(c, b) for c, b in enumerate(group) if b is not None]
        codes = np.concatenate([b.morton | np.uint32(c << 3 * log2) for c, b in there])
        joined = [np.concatenate([getattr(b, name) for _, b in there]) for name in ALL[1:]]
        made = reduce_runs(codes, *joined, bits, area)
        merged[parent] = Block(made.morton, made.mask, made.normal, made.colour, made.weight)
    return merged


def leave(level: int, key: int, encoded: dict[str, EncodedColumn]) -> None:
    """Change nothing."""


def children_of(blocks: dict[tuple[int, int], Block], level: int, key: int) -> int:
    return sum(1 << c for c in range(8) if (level - 1, 8 * key + c) in blocks)


def pile_bytes(scene: Scene, alter: Alter = leave, more: Sequence[ColumnSpec] = ()) -> bytes:
    """The scene as one pile.

    alter : called with (level, key, encoded columns) of every block; adds the columns in `more`
    """
    specs = column_specs(scene.header.normal_bits)
    file = io.BytesIO()
    with PileWriter(file, [*(specs[n] for n in scene.names), *more]) as pile:
        for (level, key), block in scene.blocks.items():
            encoded = encode_block(block, scene.log2, scene.names, scene.header.normal_bits, "fast")
            alter(level, key, encoded)
            places = decode_morton(block.morton)
            low, high = places.min(axis=0), places.max(axis=0)
            children = children_of(scene.blocks, level, key)
            pile.add(key, level, block.count, low, high, children, encoded)
    return file.getvalue()


def file_bytes(
    scene: Scene,
    kept: Sequence[str] | None = None,
    paging: Paging = DEFAULT_PAGING,
    meta: dict[str, Any] | None = None,
    extra: Sequence[tuple[bytes, bytes]] = (),
    alter: Alter = leave,
    alter_rows: Callable[[Rows], Rows] = lambda rows: rows,
    more: Sequence[ColumnSpec] = (),
) -> bytes:
    """The scene as a block file.

    alter_rows : a change to the pile's rows; more : columns of kinds that nobody knows
    """
    pile = pile_bytes(scene, alter, more)
    rows = read_pile_rows(lambda at, n: pile[at : at + n], len(pile))
    rows = alter_rows(rows)
    specs = column_specs(scene.header.normal_bits)
    columns = [*(specs[n] for n in (kept or scene.names)), *more]
    file = io.BytesIO()
    write_block_file(
        file, scene.header, rows, lambda _, at, n: pile[at : at + n],
        {"ledger": scene.ledger, **(meta or {})}, columns, paging=paging, extra=extra,
    )  # fmt: skip
    return file.getvalue()
