"""What fewer bits of colour and fewer faces cost: forms of the columns of level 0."""

import numpy as np

from gstream.formats.lodrule import LINEAR_OF_CODE
from gstream.kernels.accumulate import AREA, CHANNELS
from gstream.kernels.voxelize import Rules, compact, fragments
from gstream.report.forms.stand import SNAP_BITS, Result, Stand
from gstream.report.truth.scene import Floats, Ints

COLOUR_BITS = (4, 5, 6, 7, 8, 10)
THRESHOLDS = (0.0, 0.02, 0.05, 0.1, 0.2)  # of the normal's components


def colour_bits(stand: Stand) -> list[Result]:
    """The column's bytes and its distance from the surface's colour, in codes of 8 bits.

    The means come from the voxelizer's own sums; nothing of the file's rounding is in them.
    """
    scene = stand.scene
    if scene.colour is None or scene.vertex_colours is None:
        return []
    corners = LINEAR_OF_CODE[scene.vertex_colours][scene.triangles].astype(np.float64)
    box, rows, codes = stand.filled(corners)
    means = box.sums[rows, CHANNELS:] / (65_535.0 * box.sums[rows, AREA, None])
    true = srgb(scene.colour(stand.centres(compact(codes.astype(np.uint32)))))
    results = []
    for bits in COLOUR_BITS:
        most = 2**bits - 1
        off = np.abs(np.rint(srgb(means) * most) / most - true) * 255
        counts = {"voxels": len(rows), "bytes": -(-3 * bits * len(rows) // 8)}
        results.append(Result(bits, None, counts, {"colour_mean": float(off.mean())}))
    return results


def srgb(linear: Floats) -> Floats:
    """sRGB values, 0 to 1, of linear light; source: IEC 61966-2-1."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.003_130_8, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def faces(stand: Stand) -> list[Result]:
    """The faces kept where components of a triangle's normal up to a threshold give none.

    The error is the part of the surface, as seen along the axes, that has no face: of each voxel
    the components of the true normal whose face is not in the mask.
    """
    corners = stand.corners
    a, b, c = corners.transpose(1, 0, 2).astype(np.float64)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    owners, keys = fragments_of(stand, corners)
    order = np.argsort(keys, kind="stable")
    voxels, first = np.unique(keys[order], return_index=True)
    _, true = stand.scene.nearest(stand.centres(compact(voxels.astype(np.uint32))))
    sides = np.concatenate([-true, true], axis=1).clip(0)
    results = []
    for threshold in THRESHOLDS:
        turned = np.concatenate([-normals, normals], axis=1) > threshold
        kept = np.logical_or.reduceat(turned[owners[order]], first, axis=0)
        missing = float(sides[~kept].sum() / sides.sum())
        counts = {"voxels": len(voxels), "faces": int(kept.sum())}
        results.append(Result(threshold, None, counts, {"faces_missing": missing}))
    return results


def fragments_of(stand: Stand, corners: Ints) -> tuple[Ints, Ints]:
    """(n,) triangle and (n,) Morton code of the fragments in voxels that `--sep 6` sets."""
    rules = Rules(SNAP_BITS, "6", False, False)
    batches = [
        (owners.copy(), keys.copy(), hits.copy())
        for owners, keys, hits in fragments(corners, rules, (stand.resolution,) * 3)
    ]
    owners, keys, hits = (np.concatenate(column) for column in zip(*batches, strict=True))
    kept = np.isin(keys, keys[hits])
    return owners[kept], keys[kept]
