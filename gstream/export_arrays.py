"""Voxels as arrays: lists of them (npz) or dense occupancy (zarr).

An npz is a zip of npy files, written one array after the other, each in a pass of its own: no array
has to fit in memory. Sources: numpy.lib.format; the zarr v3 specification.
"""

from collections.abc import Iterator
from io import BytesIO
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO, Final
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from gstream.selection import Piece, Progress, Selection

SHAPES: Final[dict[str, tuple[tuple[int, ...], str]]] = {  # column -> of one voxel, dtype
    "positions": ((3,), "<u4"),
    "mask": ((), "|u1"),
    "normal": ((3,), "<f4"),
    "colour": ((4,), "|u1"),
    "weight": ((), "<u4"),
    "label": ((), "<u4"),
    "spread": ((), "|u1"),
}
MIN_CHUNK: Final = 64  # voxels of a chunk's edge: chunks are files, and 8^3 bytes are too few
EPOCH: Final = (1980, 1, 1, 0, 0, 0)  # the zip's least: no time of day in the output


def write_npz(out: BinaryIO, selection: Selection, progress: Progress) -> tuple[str, ...]:
    """Write positions and every column, and `matrix` and `level`; the columns' names.

    positions : (n, 3) u32 voxel coordinates x, y, z; matrix : (3, 4), index of the level -> world
    """
    names = tuple(name for name in SHAPES if name in selection.attributes)
    with ZipFile(out, "w", ZIP_STORED, allowZip64=True) as archive:
        for number, name in enumerate(("positions", *names)):
            shape, kind = SHAPES[name]
            with archive.open(_member(name), "w", force_zip64=True) as member:
                member.write(_npy_header((selection.voxels, *shape), kind))
                for piece in _pass(selection, name, number, 1 + len(names), progress):
                    values = piece.columns.get(name, piece.positions)
                    member.write(np.ascontiguousarray(values, kind).data)
        for name, value in (("matrix", selection.matrix), ("level", np.uint8(selection.level))):
            with archive.open(_member(name), "w") as member:
                npy.write_array(member, np.asarray(value), allow_pickle=False)
    return names


def _pass(
    selection: Selection, name: str, number: int, passes: int, progress: Progress
) -> Iterator[Piece]:
    names = () if name == "positions" else (name,)
    blocks = selection.blocks
    return selection.pieces(names, progress, number * blocks, passes * blocks)


def _member(name: str) -> ZipInfo:
    return ZipInfo(f"{name}.npy", EPOCH)


def _npy_header(shape: tuple[int, ...], kind: str) -> bytes:
    header = BytesIO()
    said: dict[str, Any] = {"descr": kind, "fortran_order": False, "shape": shape}
    npy.write_array_header_1_0(header, said)
    return header.getvalue()


def write_zarr(folder: Path, selection: Selection, progress: Progress) -> tuple[str, ...]:
    """Write occupancy as a dense u8 array [z, y, x], 1 where there is a voxel; no column's name.

    The array begins and ends at whole chunks, or at the level's end; chunks without voxels are not
    stored. Attributes: level, origin (x, y, z of element 0, 0, 0 within the level), matrix (3 x 4,
    index x, y, z of the array -> world).
    """
    import zarr

    edge = max(selection.file.block_edge, MIN_CHUNK)
    size = -(-selection.file.resolution // (1 << selection.level))
    origin = selection.first // edge * edge
    end = np.minimum((selection.last // edge + 1) * edge, size)
    matrix = selection.matrix
    matrix[:, 3] += matrix[:, :3] @ origin
    array: Any = zarr.create_array(
        store=folder,
        shape=tuple((end - origin)[::-1].tolist()),
        chunks=(edge,) * 3,
        dtype="u1",
        fill_value=0,
        dimension_names=("z", "y", "x"),
        attributes={
            "level": selection.level,
            "origin": origin.tolist(),
            "matrix": matrix.tolist(),
        },
    )
    for corner, dense in _chunks(selection, edge, progress):
        low = corner - origin
        high = np.minimum(low + edge, end - origin)
        there = tuple(slice(a, b) for a, b in zip(low[::-1], high[::-1], strict=True))
        array[there] = dense[tuple(slice(s.stop - s.start) for s in there)]
    return ()


def _chunks(
    selection: Selection, edge: int, progress: Progress
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.uint8]]]:
    """Corner (x, y, z) and content [z, y, x] of each chunk with voxels.

    Chunks are cubes of blocks, so Morton order visits each of them once.
    """

    def chunk_of(piece: Piece) -> tuple[int, ...]:
        return tuple((piece.positions[0] // edge).tolist())

    for place, pieces in groupby(selection.pieces((), progress), chunk_of):
        corner = np.array(place, np.int64) * edge
        dense = np.zeros((edge,) * 3, np.uint8)
        for piece in pieces:
            x, y, z = (piece.positions - corner).T
            dense[z, y, x] = 1
        yield corner, dense
