"""How far a block file is from the true surface, measured on what a reader decodes.

Only the public reader and NumPy: nothing here shares code with the kernels it judges.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gstream.read import BlockFile
from gstream.report.truth.oracle import distinct, exact_voxels
from gstream.report.truth.scene import Bools, Floats, Ints, Scene, codes_of_linear

WEIGHT_UNIT = 2.0**-20  # voxel faces (blockfile.md, weight)
Place = tuple[int, int, int]

REACH = 2.5  # voxels: beyond the 5^3 neighbourhood no centre is nearer
NEIGHBOURS = np.indices((5, 5, 5)).reshape(3, -1).T - 2
KEY_BITS = 17
AXES = np.eye(3, dtype=np.int64)
HALF_OF_26 = (np.indices((3, 3, 3)).reshape(3, -1).T - 1)[14:]  # the others are their opposites


@dataclass(frozen=True, slots=True)
class Content:
    """Level 0 as decoded, in Morton order over all blocks: the same for every block size."""

    positions: NDArray[np.int64]  # (n, 3)
    normals: Floats  # (n, 3) unit vectors, or 0, 0, 0 for no direction
    mask: NDArray[np.uint8]  # (n,)
    weight: NDArray[np.uint32]  # (n,) unit 2^-20 voxel faces
    colour: NDArray[np.uint8] | None = None  # (n, 4) sRGB codes and opacity


@dataclass(frozen=True, slots=True)
class Errors:
    """Distances in voxels, angles in degrees, area as a part of the true one."""

    distance_rms: float  # voxel centres to the surface
    distance_max: float
    cover_max: float  # points of the surface to the nearest voxel's centre
    normal_mean: float  # voxels' normals to the surface's where it is nearest
    normal_max: float
    area: float  # |surface in set voxels - true area| / true area
    colour_mean: float | None = None  # sRGB codes; None: the scene or the file has no colour
    colour_max: float | None = None
    misclassified: int | None = None  # None: not measured
    leaks: int | None = None  # None: not measured, or the scene is not closed


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
        np.concatenate([block.colour for block in blocks]) if "colour" in file.columns else None,
    )


def errors_of(content: Content, matrix: Floats, scene: Scene, unit: float) -> Errors:
    """The errors of a file against its scene, without misclassified voxels and leaks.

    matrix : (3, 4) voxel index -> world, a multiple of the identity and an origin
    unit : world units that distances are given in, as a voxel of the default's
    """
    size, origin = matrix[0, 0], matrix[:, 3]
    at = (content.positions + 0.5) * size + origin
    distance, normal = scene.nearest(at)
    angle = angles(content.normals, normal)
    cover = cover_distance(content.positions, (scene.samples - origin) / size)
    off = colour_distance(content, at, scene)
    area = float(content.weight.sum(dtype=np.int64)) * WEIGHT_UNIT * size**2
    return Errors(
        distance_rms=float(np.sqrt((distance**2).mean()) / unit),
        distance_max=float(distance.max() / unit),
        cover_max=float(cover.max() * size / unit),
        normal_mean=float(angle.mean()),
        normal_max=float(angle.max()),
        area=abs(area / scene.area - 1),
        colour_mean=None if off is None else float(off.mean()),
        colour_max=None if off is None else float(off.max()),
    )


def colour_distance(content: Content, at: Floats, scene: Scene) -> Floats | None:
    """(n, 3) sRGB codes between voxels' colours and the scene's where it is nearest to `at`.

    The scene's codes are not rounded: a file without any other error is 0.25 away in the mean.
    """
    if content.colour is None or scene.colour is None:
        return None
    distance: Floats = np.abs(content.colour[:, :3] - codes_of_linear(scene.colour(at)))
    return distance


def corners_of(scene: Scene, matrix: Floats) -> Floats:
    """(m, 3, 3) corners of a scene's triangles in voxels, not snapped."""
    corners: Floats = (scene.points[scene.triangles] - matrix[:, 3]) / matrix[0, 0]
    return corners


def misclassified(positions: Ints, exact: Ints) -> int:
    """Voxels that only one of two sets has: (n, 3) and (m, 3) coordinates, each once."""
    return len(np.setxor1d(_keys(positions), _keys(exact), assume_unique=True))


def leaks(positions: Ints, scene: Scene, matrix: Floats, shape: Place, sep: str) -> int | None:
    """Pairs of unset voxels whose centres lie on two sides of the surface.

    positions : (n, 3) set voxels
    shape : voxels of the grid along x, y, z
    sep : "6" | "26" | "conservative": pairs that share a face, or a corner in the other two
    returns : None where the scene is not closed
    source : S. Laine, A Topological Approach to Voxelization, CGF 32(4), 2013
    """
    if scene.inside is None:
        return None
    near = _about(exact_voxels(corners_of(scene, matrix), "conservative", (0, 0, 0), shape), shape)
    unset = near[~np.isin(_keys(near), _keys(positions))]
    inside = scene.inside((unset + 0.5) * matrix[0, 0] + matrix[:, 3])
    keys = _keys(unset)
    found = 0
    for step in AXES if sep == "6" else HALF_OF_26:
        wanted = _keys(unset + step)
        there = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        found += int(((keys[there] == wanted) & (inside[there] != inside)).sum())
    return found


def _about(positions: Ints, shape: Place) -> Ints:
    """The voxels of a grid that share at least a corner with one of (n, 3), sorted by key.

    A pair on two sides of the surface is among them: between two neighbours' centres there is no
    other voxel, so that the surface, and with it the mesh, meets one of them or of both's common
    neighbours.
    """
    keys = _keys(positions)
    for axis in range(3):
        step = 1 << KEY_BITS * axis
        keys = distinct(np.concatenate([keys - step, keys, keys + step]))
    mask = (1 << KEY_BITS) - 1
    spread = np.stack([(keys >> KEY_BITS * axis & mask) - 2 for axis in range(3)], axis=1)
    inside = (spread >= 0) & (spread < np.array(shape))
    return spread[inside.all(axis=1)]


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
    same: Bools = (content.normals[mine] == other.normals[theirs]).all(axis=1)
    same &= content.mask[mine] == other.mask[theirs]
    same &= content.weight[mine] == other.weight[theirs]
    if content.colour is not None and other.colour is not None:
        same &= (content.colour[mine] == other.colour[theirs]).all(axis=1)
    return len(keys) + len(others) - len(mine) - int(same.sum())


def differing_bytes(data: bytes, other: bytes) -> int:
    """Places at which two files differ, one that only the longer has counting too."""
    shared = min(len(data), len(other))
    both = (np.frombuffer(side, np.uint8, shared) for side in (data, other))
    return int(np.not_equal(*both).sum()) + max(len(data), len(other)) - shared


def _keys(positions: Ints) -> Ints:
    """One number for each voxel: coordinates from -2 to 65 537 fit 17 bits."""
    x, y, z = (positions + 2).T
    keys: Ints = x | y << KEY_BITS | z << 2 * KEY_BITS
    return keys
