"""What the LOD rule's weights and codes cost: other forms of the way from children to parents."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gstream.formats.lodrule import COLOUR_TABLES
from gstream.kernels.accumulate import VECTOR
from gstream.kernels.lod import finish_voxels, reduce_runs
from gstream.kernels.octahedral import decode_normals, encode_normals
from gstream.report.forms.stand import Result, Stand, no_channels, seconds_of
from gstream.report.truth.metrics import angles
from gstream.report.truth.scene import Floats, Ints

LEVEL = 3  # whose normals are judged: voxels 8 wide hold dozens of triangles
DEEPEST = 14  # levels above level 0 in a grid of 2^20 voxels with blocks of 64^3
STRANDS = 16
NORMAL_BITS = (8, 9, 10, 11, 12)
DEFAULT_BITS = 11
NO_COLOUR = np.empty((0, 4), np.uint8)

Codes = NDArray[np.uint16]


def lod_weight(stand: Stand) -> list[Result]:
    """Normals of level 3 by area, by count, and by sums that are never rounded to a code.

    The truth is the mesh: the area vectors of the triangles whose middles lie in a voxel. Scenes of
    large triangles have no such truth.
    """
    corners = stand.corners
    sizes = corners.max(axis=1) - corners.min(axis=1)
    if sizes.max() > 4 * 4096:
        return []
    box, rows, codes = stand.filled(no_channels(len(corners)))
    small = codes.astype(np.uint32)
    mask, normal, _, weight = finish_voxels(
        rows.astype(np.int32), box.sums, box.flags, False, False, DEFAULT_BITS, COLOUR_TABLES
    )
    vectors = box.sums[rows, VECTOR : VECTOR + 3]
    forms: dict[str, tuple[Callable[[], tuple[Ints, Floats]], int]] = {
        "count": (partial(_climbed, small, mask, normal, weight, False), 4),
        "area": (partial(_climbed, small, mask, normal, weight, True), 8),
        "area, never rounded": (partial(_summed, codes, vectors), 32),
    }
    where, true = _true_normals(corners)
    seconds = seconds_of({name: form for name, (form, _) in forms.items()})
    results = []
    for name, (form, size) in forms.items():
        keys, found = form()
        _, mine, theirs = np.intersect1d(keys, where, return_indices=True)
        error = float(angles(found[mine], true[theirs]).mean())
        counts = {"voxels": len(rows), "bytes": size * len(rows)}
        results.append(Result(name, seconds[name], counts, {"normal_mean": error}))
    return results


def _climbed(
    codes: NDArray[np.uint32], mask: NDArray[np.uint8], normal: Codes,
    weight: NDArray[np.uint32], by_area: bool,
) -> tuple[Ints, Floats]:  # fmt: skip
    """Morton codes and normals of LEVEL, by the file's own rule."""
    for _ in range(LEVEL):
        codes, mask, normal, _, weight = reduce_runs(
            codes, mask, normal, NO_COLOUR, weight, DEFAULT_BITS, by_area, COLOUR_TABLES
        )
    return codes.astype(np.int64), decode_normals(normal, DEFAULT_BITS).astype(np.float64)


def _summed(codes: Ints, vectors: Ints) -> tuple[Ints, Floats]:
    """Morton codes and normals of LEVEL, as sums of level 0's area vectors."""
    parents, first = np.unique(codes >> 3 * LEVEL, return_index=True)
    return parents, np.add.reduceat(vectors, first, axis=0).astype(np.float64)


def _true_normals(corners: Ints) -> tuple[Ints, Floats]:
    """Morton codes of LEVEL, and the area vectors of the triangles with their middles there.

    Without voxels whose triangles look all ways, as those of a thin thread: they have no normal.
    """
    a, b, c = corners.transpose(1, 0, 2)
    middles = (a + b + c) // (3 * 4096) >> LEVEL
    keys = np.zeros(len(corners), np.int64)
    for axis in range(3):
        for bit in range(8):
            keys |= (middles[:, axis] >> bit & 1) << (3 * bit + axis)
    parents, owner = np.unique(keys, return_inverse=True)
    cross = np.cross(b - a, c - a).astype(np.float64)
    sums = np.stack([np.bincount(owner, cross[:, axis], len(parents)) for axis in range(3)], axis=1)
    areas = np.bincount(owner, np.linalg.norm(cross, axis=1), len(parents))
    one_way = np.linalg.norm(sums, axis=1) > 0.5 * areas
    return parents[one_way], sums[one_way]


def lod_codes(_: Stand) -> list[Result]:
    """Normals of level 14 where each level is made of the codes of the one before.

    16 strands of 2^14 voxels in a row, which a level halves; their normals turn smoothly, with
    noise; their areas differ. The truth is the sum over all of a strand's voxels in float64. The
    other form rounds sums to a code of the default's bits once, at the end.
    """
    random = np.random.default_rng(14)
    along = np.linspace(0, 1, 2**DEEPEST)
    turns = random.uniform(0.2, 1.0, (STRANDS, 1)) * np.pi * along + random.uniform(
        0, 6, (STRANDS, 1)
    )
    smooth = np.stack([np.cos(turns), np.sin(turns), np.ones_like(turns)], axis=2)
    normals = smooth + 0.2 * random.standard_normal(smooth.shape)
    vectors = np.rint(normals.reshape(-1, 3) * 2**20).astype(np.int64)
    weight = random.integers(1, 2**20, len(vectors)).astype(np.uint32)
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    true = (unit * weight[:, None]).reshape(STRANDS, -1, 3).sum(axis=1)

    def climbed(bits: int) -> Floats:
        place, shares = np.arange(len(vectors), dtype=np.uint32), weight
        mask, normal = np.ones(len(vectors), np.uint8), encode_normals(vectors, bits)
        for _ in range(DEEPEST):
            pairs = place >> np.uint32(1) << np.uint32(3) | place & np.uint32(1)
            place, mask, normal, _, shares = reduce_runs(
                pairs, mask, normal, NO_COLOUR, shares, bits, True, COLOUR_TABLES
            )
        found: Floats = decode_normals(normal, bits).astype(np.float64)
        return found

    def at_the_end() -> Floats:
        directions = np.rint(unit * 2**15).astype(np.int64)
        sums = (directions * weight[:, None].astype(np.int64)).reshape(STRANDS, -1, 3).sum(axis=1)
        normal = encode_normals(sums, DEFAULT_BITS)
        found: Floats = decode_normals(normal, DEFAULT_BITS).astype(np.float64)
        return found

    forms: dict[str, Callable[[], Floats]] = {
        str(bits): partial(climbed, bits) for bits in NORMAL_BITS
    }
    forms["once"] = at_the_end
    seconds = seconds_of(forms)
    results = []
    for name, form in forms.items():
        off = angles(form(), true)
        counts = {"voxels": len(vectors), "bytes": (32 if name == "once" else 8) * len(vectors)}
        results.append(Result(name, seconds[name], counts, {"normal_mean": float(off.mean())}))
    return results
