"""`gstream export`: a level of a block file as PLY, npz or zarr, block by block.

Here: which kind, atomic output, the summary. The formats are in gstream/export_ply.py and
gstream/export_arrays.py.
"""

import errno
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gstream.compiled import compiled
from gstream.errors import RefusedError, StoppedError, UsageError
from gstream.export_arrays import write_npz, write_zarr
from gstream.export_ply import MAX_CUBES, write_cubes, write_points, write_triangles
from gstream.formats.pieces import TRIANGLE, VERTEX
from gstream.read import open_block_file
from gstream.run.publish import publish, publish_folder
from gstream.selection import Progress, Selection

KINDS: Final = (".ply", ".npz", ".zarr")
FULL: Final = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EFBIG}


@dataclass(frozen=True, slots=True)
class ExportInfo:
    """What was written."""

    output: str
    kind: str  # ply | npz | zarr
    level: int
    blocks: int
    voxels: int
    columns: tuple[str, ...]  # beside the positions
    left_out: tuple[str, ...]  # columns that the file stores and the output has not
    bytes: int


def kind_of(output: str, cubes: bool, geometry: bool = False) -> str:
    """One of KINDS, by the name's end.

    errors : UsageError for another one, for cubes or triangles of it, and a folder that is no zarr
    """
    kind = Path(output).suffix.lower()
    if kind not in KINDS:
        raise UsageError(f"{output}: no kind of export", f"end its name in {', '.join(KINDS)}")
    if cubes and kind != ".ply":
        raise UsageError(f"{output}: cubes are for .ply alone", "drop --cubes or name a .ply")
    if geometry and kind != ".ply":
        raise UsageError(
            f"{output}: triangles are for .ply alone", "drop --geometry or name a .ply"
        )
    if kind == ".zarr" and os.path.exists(output) and not (Path(output) / "zarr.json").is_file():
        raise UsageError(f"{output}: exists and is no zarr array", "name another output")
    return kind


def export(
    path: str,
    output: str,
    level: int = 0,
    bounds: Sequence[float] | None = None,
    cubes: bool = False,
    progress: Progress = lambda done, total: None,
    *,
    geometry: bool = False,
) -> ExportInfo:
    """Write the voxels of a level that touch a world box into `output`, replacing it.

    path : block file, or its URL
    bounds : low x y z, high x y z; None = the whole level
    cubes : of a PLY, cubes instead of points
    geometry : of a PLY, the source triangles of blocks of level 0 that have a voxel in the box
    errors : UsageError, RefusedError; StoppedError when the disk is full; those of reading
    """
    kind = kind_of(output, cubes, geometry)
    if geometry and (cubes or level):
        raise UsageError("source triangles are level 0 alone, and no cubes", "drop the other")
    with open_block_file(path, choose=compiled) as file:
        if geometry and not {VERTEX, TRIANGLE} <= set(file.columns):
            raise UsageError(f"{path}: stores no source triangles", "build it --keep-geometry")
        selection = Selection.of(file, level, bounds)
        if cubes and selection.voxels > MAX_CUBES:
            said = f"{selection.voxels:,} cubes have more corners than a PLY can number"
            raise RefusedError(said, f"give at most {MAX_CUBES:,}: a coarser --level, or --bounds")
        try:
            columns = _write(selection, output, kind, cubes, geometry, progress)
        except OSError as error:
            if error.errno not in FULL:
                raise
            said = f"{output}: {os.strerror(error.errno)} while it was written"
            raise StoppedError(said, "free some space, then run the same command again") from error
        stored = tuple(name for name in file.columns if name != "occupancy")
    left_out = tuple(name for name in stored if name not in columns)
    size = sum(p.stat().st_size for p in (Path(output), *Path(output).rglob("*")) if p.is_file())
    counts = (selection.blocks, selection.voxels)
    return ExportInfo(output, kind[1:], level, *counts, columns, left_out, size)


def _write(
    selection: Selection, output: str, kind: str, cubes: bool, geometry: bool, progress: Progress
) -> tuple[str, ...]:
    """Write one kind; the names of the columns that are in it."""
    if kind == ".zarr":
        with publish_folder(output) as folder:
            return write_zarr(folder, selection, progress)
    write = write_triangles if geometry else write_cubes if cubes else write_points
    write = write_npz if kind == ".npz" else write
    with publish(output) as out:
        return write(out, selection, progress)
