"""What sums in integers cost: `accumulate` with floats in place of fixed point.

A float rounds each sum on its way, so that the result depends on the order of the fragments; in
fixed point no order can change a bit. The error is the number of voxels that come out otherwise
when the same fragments are added up backwards.
"""

from collections.abc import Callable
from functools import partial
from types import FunctionType
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gstream.formats.lodrule import COLOUR_TABLES
from gstream.kernels import accumulate, fragments, part
from gstream.kernels.lod import finish_voxels
from gstream.kernels.select import collect
from gstream.kernels.voxelize import SPREAD, Rules
from gstream.report.forms.stand import BUFFER, SNAP_BITS, Result, Stand, no_channels, seconds_of

Numbers = NDArray[Any]
Accumulate = Callable[..., int]
Buffers = tuple[Numbers, ...]  # keys, owners, hits, areas, channels, normals, masks
Added = tuple[Numbers, Numbers, Numbers, Numbers]  # tile slots, tiles, sums, flags

TILES = 1 << 15  # of a box of 256^3 voxels


def accumulate_in(number: type) -> Accumulate:
    """`accumulate` with sums of type `number`, which keep fractions of a unit."""

    @part
    def fixed(value: float) -> Any:
        return number(value)

    exact: Any = accumulate.accumulate
    names = exact.py_func.__globals__ | {"fixed": fixed}
    code = FunctionType(exact.py_func.__code__, names)
    code.__qualname__ = f"accumulate_{number.__name__}"  # its own name in numba's cache
    compiled: Accumulate = njit(nogil=True, error_model="numpy", cache=True)(code)
    return compiled


def measure(stand: Stand) -> list[Result]:
    """Seconds of each form, bytes of its sums, and how many voxels the order changes."""
    forward = emitted(stand)
    backward = tuple(a[::-1].copy() for a in forward[:5]) + forward[5:]
    forms: dict[str, tuple[Accumulate, type]] = {
        number.__name__: (accumulate_in(number), number) for number in (np.float32, np.float64)
    }
    forms["int64"] = accumulate.accumulate, np.int64
    voxels = len(np.unique(forward[0]))
    seconds = seconds_of(
        {name: partial(added, *form, forward, voxels) for name, form in forms.items()}
    )
    changed = {}
    for name, form in forms.items():
        one, other = (attributes(*added(*form, way, voxels)) for way in (forward, backward))
        changed[name] = float((one != other).any(axis=1).sum())
    return [
        Result(
            name,
            seconds[name],
            {
                "fragments": len(forward[0]),
                "voxels": voxels,
                "bytes": accumulate.CHANNELS * np.dtype(number).itemsize * voxels,
            },
            {"order": changed[name]},
        )
        for name, (_, number) in forms.items()
    ]


def emitted(stand: Stand) -> Buffers:
    """All fragments of a scene, as `accumulate` takes them."""
    corners = stand.corners
    n = len(corners)
    normals, masks, assigned = np.ones((n, 4)), np.empty(n, np.uint8), np.zeros(n, np.bool_)
    outputs = (
        np.empty(BUFFER, np.uint32), np.empty(BUFFER, np.int32), np.empty(BUFFER, np.bool_),
        np.empty(BUFFER), np.empty((BUFFER, 0)),
    )  # fmt: skip
    order, rules = np.arange(n, dtype=np.int32), Rules(SNAP_BITS, "6", False, False).packed()
    place, slab = 0, -1
    batches = []
    while place < n:
        place, slab, count = fragments.emit(
            corners, no_channels(n), order, rules, (stand.resolution,) * 3, (place, slab), SPREAD,
            normals, masks, assigned, *outputs,
        )  # fmt: skip
        batches.append([output[:count].copy() for output in outputs])
    return *(np.concatenate(column) for column in zip(*batches, strict=True)), normals, masks


def added(form: Accumulate, number: type, buffers: Buffers, voxels: int) -> Added:
    """The sums of all fragments; `voxels` : how many different keys there are."""
    slots = np.full(TILES, -1, np.int32)
    tiles = np.empty((TILES, accumulate.TILE_VOXELS), np.int32)
    sums: Numbers = np.zeros((voxels + accumulate.CHUNK, accumulate.CHANNELS), number)
    flags = np.zeros(len(sums), np.uint8)
    form(len(buffers[0]), *buffers, slots, tiles, np.zeros(2, np.int64), sums, flags)
    return slots, tiles, sums, flags


def attributes(slots: Numbers, tiles: Numbers, sums: Numbers, flags: Numbers) -> Numbers:
    """(n, 3) u4: what level 0 would store of each voxel, normal codes and weight."""
    rows, _ = collect(slots, tiles, flags, 0)
    whole = np.rint(sums).astype(np.int64)
    _, normal, _, weight = finish_voxels(rows, whole, flags, False, False, 11, COLOUR_TABLES)
    return np.column_stack([normal, weight])
