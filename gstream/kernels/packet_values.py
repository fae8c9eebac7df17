"""Packets of small triangles: areas and channels of the voxel at hand, and writing its fragments.

See `packets.py`; rows are those of `packet_rows.py`.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part
from gstream.kernels.lanes import (
    LANES,
    at,
)
from gstream.kernels.packet_rows import (
    AFFINE_ROWS,
    AREA,
    CODE,
    CORNER,
    EDGE,
    FACTOR,
    LARGEST,
    LEAST,
    MEAN,
    MEAN_U,
    MEAN_V,
    MISSED,
    NORMAL,
    OUTSIDE,
    OWNER,
    PASSED,
    PASSED_V,
    PLACES,
    VALUE,
)

I64 = NDArray[np.int64]
I32 = NDArray[np.int32]
U32 = NDArray[np.uint32]
F64 = NDArray[np.float64]


@part
def start_row(words: I64, reals: F64, j: int, l: int) -> None:
    """Values of the first voxel of row (j, l)."""
    for lane in range(LANES):
        words[at(VALUE, lane)] = words[at(NORMAL + 2, lane)] * l + words[at(NORMAL + 1, lane)] * j
        reals[at(PASSED, lane)] = 0.0
        reals[at(PASSED_V, lane)] = 0.0


@part
def area_of_voxel(own: F64, beyond: F64, voxel: int, reals: F64) -> None:
    """Row AREA of the next voxel of a row."""
    for lane in range(LANES):
        passed = reals[at(PASSED, lane)]
        reals[at(AREA, lane)] = abs(passed + own[at(voxel, lane)]) * reals[at(FACTOR, lane)]
        reals[at(PASSED, lane)] = passed + beyond[at(voxel, lane)]


@part
def prepare_channels(words: I64, k: int, values: F64, names: U32, affine: F64) -> None:
    """Each channel as an affine function of (u, v), or the corners' mean where there is no area."""
    scale = 1.0 / (1 << k)
    for c in range(values.shape[2]):
        row = AFFINE_ROWS * c
        for lane in range(LANES):
            t = np.uint64(names[at(OWNER, lane)])
            for a in range(3):
                corner = np.uint64(words[at(PLACES + a, lane)])
                affine[at(row + a, lane)] = values[t, corner, c]
        for lane in range(LANES):
            u, v = words[at(CORNER, lane)], words[at(CORNER + 1, lane)]
            a, b = words[at(CORNER + 3, lane)] - u, words[at(CORNER + 4, lane)] - v
            d, e = words[at(CORNER + 6, lane)] - u, words[at(CORNER + 7, lane)] - v
            det = np.float64(a * e - b * d) * scale
            first = affine[at(row, lane)]
            second, third = affine[at(row + 1, lane)] - first, affine[at(row + 2, lane)] - first
            some = words[at(NORMAL + 2, lane)] != 0
            along_u = (second * e - third * b) / det if some else 0.0
            along_v = (third * a - second * d) / det if some else 0.0
            start = first - (along_u * u + along_v * v) * scale
            affine[at(row, lane)] = start if some else first + (second + third) / 3.0
            affine[at(row + 1, lane)], affine[at(row + 2, lane)] = along_u, along_v
            affine[at(row + LEAST, lane)] = first + min(0.0, min(second, third))
            affine[at(row + LARGEST, lane)] = first + max(0.0, max(second, third))


@part
def mean_of_voxel(
    own: F64, moments: F64, voxel: int, voxels: int, i: int, j: int, reals: F64
) -> None:
    """Rows MEAN_U and MEAN_V of the next voxel of a row; before `area_of_voxel`."""
    along_u, along_v, beyond_v = voxel, voxel + voxels, voxel + 2 * voxels
    for lane in range(LANES):
        passed, passed_v = reals[at(PASSED, lane)], reals[at(PASSED_V, lane)]
        area = passed + own[at(voxel, lane)]
        some = area != 0.0
        u = (0.5 * passed + moments[at(along_u, lane)]) / area if some else 0.5
        v = (passed_v + moments[at(along_v, lane)]) / area if some else 0.5
        reals[at(MEAN_U, lane)] = i + min(max(u, 0.0), 1.0)
        reals[at(MEAN_V, lane)] = j + min(max(v, 0.0), 1.0)
        reals[at(PASSED_V, lane)] = passed_v + moments[at(beyond_v, lane)]


@part
def mean_channels(reals: F64, count: int, affine: F64) -> None:
    """Row MEAN of each channel, within the range of the triangle's corners."""
    for c in range(count):
        row = AFFINE_ROWS * c
        for lane in range(LANES):
            value = (
                affine[at(row, lane)]
                + affine[at(row + 1, lane)] * reals[at(MEAN_U, lane)]
                + affine[at(row + 2, lane)] * reals[at(MEAN_V, lane)]
            )
            least, most = affine[at(row + LEAST, lane)], affine[at(row + LARGEST, lane)]
            affine[at(row + MEAN, lane)] = min(max(value, least), most)


@part
def name_voxel(codes: U32, i: int, j: int, l: int, names: U32) -> None:
    """Row CODE of the voxel (i, j, l)."""
    for lane in range(LANES):
        names[at(CODE, lane)] = (
            codes[at(i, lane)] | codes[at(EDGE + j, lane)] | codes[at(2 * EDGE + l, lane)]
        )


@part
def write_voxel(
    verdicts: I32, names: U32, reals: F64, count: np.uint64,
    keys: U32, owners: I32, hits: NDArray[np.bool_], areas: F64,
) -> int:  # fmt: skip
    """Write a fragment for each lane, and keep those that are not outside."""
    for lane in range(LANES):
        keys[count] = names[at(CODE, lane)]
        owners[count] = names[at(OWNER, lane)]
        hits[count] = verdicts[at(MISSED, lane)] >= 0
        areas[count] = reals[at(AREA, lane)]
        count += np.uint64(1) - (np.uint64(np.uint32(verdicts[at(OUTSIDE, lane)])) >> np.uint64(31))
    return np.int64(count)


@part
def write_channels(verdicts: I32, affine: F64, count: np.uint64, channels: F64) -> None:
    """As `write_voxel`, the channels alone; before it."""
    for c in range(channels.shape[1]):  # outside: else this short loop becomes the vector
        place = count
        for lane in range(LANES):
            channels[place, np.uint64(c)] = affine[at(AFFINE_ROWS * c + MEAN, lane)]
            outside = np.uint64(np.uint32(verdicts[at(OUTSIDE, lane)])) >> np.uint64(31)
            place += np.uint64(1) - outside
