"""How far a block file is from the true surface, measured on what a reader decodes.

Only the public reader and NumPy: nothing here shares code with the kernels it judges.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gstream.read import BlockFile
from gstream.report.scenes import Floats, Scene

WEIGHT_UNIT = 2.0**-20  # voxel faces (blockfile.md, weight)
REACH = 2.5  # voxels: beyond the 5^3 neighbourhood no centre is nearer
NEIGHBOURS = np.indices((5, 5, 5)).reshape(3, -1).T - 2


@dataclass(frozen=True, slots=True)
class Content:
    """Level 0 as decoded, in Morton order over all blocks: the same for every block size."""

    positions: NDArray[np.int64]  # (n, 3)
    normals: Floats  # (n, 3) unit vectors, or 0, 0, 0 for no direction
    mask: NDArray[np.uint8]  # (n,)
    weight: NDArray[np.uint32]  # (n,) unit 2^-20 voxel faces


@dataclass(frozen=True, slots=True)
class Errors:
    """Distances in voxels, angles in degrees, area as a part of the true one."""

    distance_rms: float  # voxel centres to the surface
    distance_max: float
    cover_max: float  # points of the surface to the nearest voxel's centre
    normal_mean: float  # voxels' normals to the surface's where it is nearest
    normal_max: float
    area: float  # |surface in set voxels - true area| / true area


def read_content(file: BlockFile) -> Content:
    """Decode level 0 of a file that keeps its weights.

    errors : CorruptFileError, UnsupportedError
    """
    blocks = list(file.blocks(level=0))
    return Content(
        np.concatenate([block.positions() for block in blocks]).astype(np.int64),
        np.concatenate([block.normals() for block in blocks]).astype(np.float64),
        np.concatenate([block.mask for block in blocks]),
        np.concatenate([block.weight for block in blocks]),
    )


def errors_of(content: Content, matrix: Floats, scene: Scene, unit: float) -> Errors:
    """Every error of a file against its scene.

    matrix : (3, 4) voxel index -> world, a multiple of the identity and an origin
    unit : world units that distances are given in, as a voxel of the default's
    """
    size, origin = matrix[0, 0], matrix[:, 3]
    distance, normal = scene.nearest((content.positions + 0.5) * size + origin)
    angle = angles(content.normals, normal)
    cover = cover_distance(content.positions, (scene.samples - origin) / size)
    area = float(content.weight.sum(dtype=np.int64)) * WEIGHT_UNIT * size**2
    return Errors(
        distance_rms=float(np.sqrt((distance**2).mean()) / unit),
        distance_max=float(distance.max() / unit),
        cover_max=float(cover.max() * size / unit),
        normal_mean=float(angle.mean()),
        normal_max=float(angle.max()),
        area=abs(area / scene.area - 1),
    )


def angles(found: Floats, true: Floats) -> Floats:
    """(n,) degrees between (n, 3) vectors; 90 where there is no direction.

    By the arc tangent: an arc cosine cannot tell 0 from 0.02 degrees of float32 vectors.
    """
    sine = np.linalg.norm(np.cross(found, true), axis=1)
    cosine = (found * true).sum(axis=1)
    turned: Floats = np.degrees(np.arctan2(sine, cosine))
    return np.where(found.any(axis=1), turned, 90.0)


def cover_distance(positions: NDArray[np.int64], points: Floats) -> Floats:
    """(k,) voxels from each point to the nearest of the voxels' centres; 2.5 for that or more.

    positions : (n, 3) voxel coordinates
    points : (k, 3) in voxel coordinates
    """
    keys = np.sort(_keys(positions))
    cell = np.floor(points).astype(np.int64)
    best = np.full(len(points), REACH)
    for step in NEIGHBOURS:
        wanted = _keys(cell + step)
        there = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        distance = np.linalg.norm(points - (cell + step + 0.5), axis=1)
        best = np.where(keys[there] == wanted, np.minimum(best, distance), best)
    return best


def differing_voxels(content: Content, other: Content) -> int:
    """Voxels that only one of two files has, or that both have with another attribute."""
    keys, others = _keys(content.positions), _keys(other.positions)
    _, mine, theirs = np.intersect1d(keys, others, assume_unique=True, return_indices=True)
    same = (content.normals[mine] == other.normals[theirs]).all(axis=1)
    same &= content.mask[mine] == other.mask[theirs]
    same &= content.weight[mine] == other.weight[theirs]
    return len(keys) + len(others) - len(mine) - int(same.sum())


def differing_bytes(data: bytes, other: bytes) -> int:
    """Places at which two files differ, one that only the longer has counting too."""
    shared = min(len(data), len(other))
    both = (np.frombuffer(side, np.uint8, shared) for side in (data, other))
    return int(np.not_equal(*both).sum()) + max(len(data), len(other)) - shared


def _keys(positions: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number for each voxel: coordinates from -2 to 65 537 fit 17 bits."""
    x, y, z = (positions + 2).T
    keys: NDArray[np.int64] = x | y << 17 | z << 34
    return keys
