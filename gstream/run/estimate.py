"""What a stream will take on disk, told from its chunk table and a sample of its triangles.

A plane has a known number of voxels per area (kernels/foresee.py); so has any mesh whose folds are
not much finer than its voxels. Measured: 0.5 % too many on three scans, 4 to 6 % on a sphere with
white noise.
"""

from collections.abc import Iterator
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.formats.cells import grid_of_stream
from gstream.formats.stream import StreamReader
from gstream.formats.stream_chunk import Chunk
from gstream.job import VoxelizeSettings
from gstream.kernels import indexing
from gstream.kernels.foresee import foresee
from gstream.run.budget import DiskNeed

SAMPLED_CHUNKS: Final = 16  # 4 ms each
# Bytes of file per voxel of level 0, all levels and columns: five scans and a noisy sphere have 4.0
# to 5.3 where voxels are 6-separating, four of them 3.4 to 4.5 where they are not.
FILE_BYTES: Final = {"6": 4.7, "26": 3.9, "conservative": 3.9}
# Of these, without normals 0.6 to 1.3 are left of three scans; a smooth sphere has 2.1 in normals.
NORMAL_BYTES: Final = {"6": 3.5, "26": 3.1, "conservative": 3.1}
# Where blocks see one triangle, most have one normal, and directory rows are half of the piles.
FLAT_BYTES: Final = {"6": 0.64, "26": 0.33, "conservative": 0.33}
FLAT_PILES: Final = 2.0
COLOUR_BYTES: Final = 2.2  # of a photograph; a block of one colour stores none
PILES: Final = (
    1.07  # of the file's bytes: the same payloads with their rows, and weights for levels
)
# Source triangles: bytes of each piece (5.5 to 6.5 on four scans and CAD, 9 where they are larger
# than 5 voxels), and pieces more than triangles, in sqrt(faces * triangles) / block (8 to 10).
PIECE_BYTES, PIECES_AT_BORDERS = 6.5, 10.0
INDEX_BYTES, VERTEX_BYTES, CORNER_BYTES, WORD_BYTES = 6, 8, 36, 12  # formats/cells.py
CELL_BORDERS: Final = 1.04  # vertices that several segments of one unit have


def disk_of_stream(path: str, settings: VoxelizeSettings) -> DiskNeed:
    """Scratch and output of voxelizing a stream.

    errors : CorruptFileError, UnsupportedError of the stream; UsageError of a grid that cannot be
    """
    reader = StreamReader(path, indexing)
    if reader.box is None:
        return DiskNeed(0, 0)
    low, high = reader.box
    box = ((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    grid = grid_of_stream(box, reader.metadata, settings)
    cell = max(settings.cell, settings.block, -(-grid.resolution // 256))
    sums = np.zeros(4)
    triangles = varied = 0
    for chunk in _sample(reader):
        points: NDArray[Any] = (chunk.positions.astype(np.float64) - grid.origin) / grid.voxel_size
        corners = chunk.triangles
        if corners is None:
            corners = np.arange(len(points), dtype=np.uint16).reshape(-1, 3)
        foresee(points, corners, float(cell), settings.sep == "6", sums)
        triangles += len(corners)
        if chunk.colours is not None and (chunk.colours != chunk.colours[0]).any():
            varied += len(corners)
    faces, flat, references, large = sums.tolist()
    rows = reader.chunks
    total = int(rows["triangles"].sum(dtype=np.int64))
    share = total / max(triangles, 1)
    shared = int(rows["vertices"].sum(dtype=np.int64)) / max(total, 1) * CELL_BORDERS
    coloured = any(attribute.name == "colour" for attribute in reader.attributes)
    coloured &= settings.stores("colour")
    input_normals = settings.stores("normal") and settings.normals == "input"
    words = WORD_BYTES * (coloured + 2 * input_normals)
    presorted = references * (INDEX_BYTES + VERTEX_BYTES * shared + words)
    presorted += large * (CORNER_BYTES + words)
    per_voxel = FILE_BYTES[settings.sep]
    per_voxel += coloured * COLOUR_BYTES * varied / max(triangles, 1)
    per_voxel -= 0 if settings.stores("normal") else NORMAL_BYTES[settings.sep]
    rough, even = faces * share * per_voxel, flat * share * FLAT_BYTES[settings.sep]
    kept = 0.0
    if settings.keep_geometry:
        at_borders = PIECES_AT_BORDERS * sqrt((faces + flat) * share * total) / settings.block
        kept = PIECE_BYTES * (total + at_borders)
    scratch = presorted * share + PILES * (rough + kept) + FLAT_PILES * even
    return DiskNeed(scratch=int(scratch), output=int(rough + kept + even))


def _sample(reader: StreamReader) -> Iterator[Chunk]:
    """Up to SAMPLED_CHUNKS chunks, evenly spread over the stream."""
    count = len(reader.chunks)
    for number in np.unique(np.linspace(0, count - 1, min(count, SAMPLED_CHUNKS)).astype(int)):
        chunk = reader.chunk(int(number), ("colour",))
        if chunk.triangle_count:
            yield chunk
