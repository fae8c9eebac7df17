"""What exact classification costs: `fragments.emit` with floats in place of integers.

The same code, compiled anew with another type of number and the set-ups below in place of the exact
ones. The floats get every help: vertices snapped alike, a frame at the triangle, ties moved by one
step of the float, sums of products in float64. Vertices are where the far corner of a 16384^3 grid
would have them, so that float32 has 10 of its 24 bits left for places within a voxel.
"""

from collections.abc import Callable
from functools import partial
from types import FunctionType
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gstream.kernels import fragments, part
from gstream.kernels.fragments import sort_corners
from gstream.kernels.overlap import (
    CEIL,
    CENTRE_CEIL,
    CENTRE_FLOOR,
    FLOOR,
    first_sign,
    longest_edge,
    tie,
)
from gstream.kernels.voxelize import SPREAD, Rules, compact
from gstream.report.forms.stand import BUFFER, SNAP_BITS, Result, Stand, no_channels, seconds_of
from gstream.report.truth.metrics import misclassified
from gstream.report.truth.oracle import exact_voxels
from gstream.report.truth.scene import Ints

Numbers = NDArray[Any]
Emit = Callable[..., tuple[int, int, int]]

FAR = 16_384  # voxels along an axis of the grid that the scene is the far corner of


def emit_in(number: type) -> Emit:
    """`fragments.emit` with floats of type `number`; corners in voxels, snap bits 0."""
    infinity = number(np.inf)

    @part
    def load_triangle(
        corners: Numbers, k: int, closed: bool, tri: Numbers, box: Numbers, order: Numbers
    ) -> int:
        for c in range(3):
            low = min(corners[0, c], corners[1, c], corners[2, c])
            high = max(corners[0, c], corners[1, c], corners[2, c])
            base = np.int64(np.floor(low))
            box[0, c], box[1, c], box[2, c] = base, 0, np.int64(np.floor(high)) - base
        turn = sort_corners(corners, order)
        for a in range(3):
            for c in range(3):
                tri[a, c] = corners[order[a], c] - box[0, c]
        return turn

    @part
    def plane_out_of_reach(plane: Numbers, tri: Numbers, k: int, low: Numbers) -> bool:
        return False  # floats do not overflow

    @part
    def moved(values: Numbers, slot: int, value: float, way: int) -> None:
        values[slot] = value
        if way != 0:
            values[slot] = np.nextafter(values[slot], infinity if way > 0 else -infinity)

    @part
    def prepare_plane(tri: Numbers, k: int, closed: bool, low: Numbers, plane: Numbers) -> None:
        sign = first_sign(plane[0], plane[1], plane[2])
        up, down = tie(sign, closed), tie(-sign, closed)
        whole = 0.0
        for c in range(3):
            whole += plane[c] * (tri[0, c] - low[c])
        moved(plane, CEIL, whole, up)
        moved(plane, FLOOR, whole, -down)
        for r in range(3):
            across = 0.5 * (plane[(r + 1) % 3] + plane[(r + 2) % 3])
            moved(plane, CENTRE_CEIL + r, whole - across, up)
            moved(plane, CENTRE_FLOOR + r, whole - across, -down)

    @part
    def edge_rule(
        tri: Numbers, start: int, end: int, turn: int, closed: bool,
        r: int, p: int, q: int, slot: int, edges: Numbers, centres: Numbers,
    ) -> None:  # fmt: skip
        a = turn * (tri[start, q] - tri[end, q])
        b = turn * (tri[end, p] - tri[start, p])
        sign = first_sign(b, a, 0) if r == 1 else first_sign(a, b, 0)
        c = -a * tri[start, p] - b * tri[start, q]
        edges[r, slot, 0], edges[r, slot, 1] = a, b
        moved(edges[r, slot], 2, c + max(a, 0.0) + max(b, 0.0), -tie(sign, closed))
        moved(centres[r], slot, c + 0.5 * (a + b), -tie(sign, closed))

    @part
    def prepare_edges(
        tri: Numbers, plane: Numbers, k: int, closed: bool, edges: Numbers, centres: Numbers
    ) -> None:
        for r in range(3):
            p, q = (r + 1) % 3, (r + 2) % 3
            if plane[r] == 0.0:
                e = longest_edge(tri, p, q)
                end = e + 1 if e < 2 else 0
                edge_rule(tri, e, end, 1, closed, r, p, q, 0, edges, centres)
                edge_rule(tri, e, end, -1, closed, r, p, q, 1, edges, centres)
                edge_rule(tri, e, end, 0, closed, r, p, q, 2, edges, centres)
            else:
                turn = 1 if plane[r] > 0.0 else -1
                edge_rule(tri, 0, 1, turn, closed, r, p, q, 0, edges, centres)
                edge_rule(tri, 1, 2, turn, closed, r, p, q, 1, edges, centres)
                edge_rule(tri, 2, 0, turn, closed, r, p, q, 2, edges, centres)

    @part
    def no_diagonals(tri: Numbers, plane: Numbers, k: int, closed: bool, lines: Numbers,
                     ends: Numbers) -> None:  # fmt: skip
        pass

    @part
    def meets_no_diagonal(
        tri: Numbers, plane: Numbers, lines: Numbers, ends: Numbers, k: int, closed: bool,
        voxel: Numbers, value: float,
    ) -> bool:  # fmt: skip
        return False

    exchanged = {
        "NUMBER": number,
        "load_triangle": load_triangle,
        "plane_out_of_reach": plane_out_of_reach,
        "prepare_plane": prepare_plane,
        "prepare_edges": prepare_edges,
        "prepare_diagonals": no_diagonals,  # of mode 26, which is not asked here
        "meets_diagonals": meets_no_diagonal,
    }
    exact: Any = fragments.emit
    assert exchanged.keys() <= exact.py_func.__globals__.keys()
    names = exact.py_func.__globals__ | exchanged
    code = FunctionType(exact.py_func.__code__, names)
    code.__qualname__ = f"emit_{number.__name__}"  # its own name in numba's cache
    compiled: Emit = njit(nogil=True, error_model="numpy", cache=True)(code)
    return compiled


def measure(stand: Stand) -> list[Result]:
    """Seconds of each form, and how many voxels it sets or leaves out wrongly."""
    corners, edge = stand.corners, stand.resolution
    exact = exact_voxels(corners / 2.0**SNAP_BITS, "6", (0, 0, 0), (edge,) * 3)
    forms: dict[str, tuple[Emit, Numbers, int]] = {
        number.__name__: (emit_in(number), seen_from_afar(corners, number), 0)
        for number in (np.float32, np.float64)
    }
    forms["exact"] = fragments.emit, corners, SNAP_BITS
    found = {name: classify(*form, edge) for name, form in forms.items()}
    seconds = seconds_of({name: partial(classify, *form, edge) for name, form in forms.items()})
    return [
        Result(
            name,
            seconds[name],
            {"triangles": len(corners), "fragments": count, "voxels": len(voxels)},
            {"misclassified": float(misclassified(voxels, exact))},
        )
        for name, (count, voxels) in found.items()
    ]


def classify(emit: Emit, corners: Numbers, snap_bits: int, edge: int) -> tuple[int, Ints]:
    """How many fragments, and the voxels of `--sep 6`, in a box of edge^3 voxels.

    corners : (n, 3, 3)   units of 2^-snap_bits voxel
    returns : count, (m, 3) i8 voxels
    """
    n = len(corners)
    normals, masks, assigned = np.ones((n, 4)), np.empty(n, np.uint8), np.zeros(n, np.bool_)
    keys, owners = np.empty(BUFFER, np.uint32), np.empty(BUFFER, np.int32)
    hits, areas = np.empty(BUFFER, np.bool_), np.empty(BUFFER)
    values, none = no_channels(n), np.empty((BUFFER, 0))
    order, rules = np.arange(n, dtype=np.int32), Rules(snap_bits, "6", False, False).packed()
    place, slab, total = 0, -1, 0
    met = np.zeros(1 << 24, np.bool_)
    while place < n:
        place, slab, count = emit(
            corners, values, order, rules, (edge,) * 3, (place, slab), SPREAD,
            normals, masks, assigned, keys, owners, hits, areas, none,
        )  # fmt: skip
        total += count
        met[keys[:count][hits[:count]]] = True
    return total, compact(np.flatnonzero(met).astype(np.uint32))


def seen_from_afar(corners: Ints, number: type) -> Numbers:
    """Corners in voxels that were floats at the far corner of a FAR^3 grid."""
    shift = FAR - 256
    afar: Numbers = (corners / 2.0**SNAP_BITS + shift).astype(number) - number(shift)
    return afar
