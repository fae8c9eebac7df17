"""Triangles to fragments: which voxels of a box a triangle meets, with how much area.

A fragment is one (triangle, voxel) pair. Fragments go to a small buffer that stays in the L2 cache;
`accumulate.py` adds them up in a second loop, which measured 1.5 to 2 times faster than one fused
loop (numerics.md section 3). Membership is decided by integers (`overlap.py`, `targets.py`), areas
are float64 (`clip.py`), both in a frame fixed by the triangle: the low corner of the lowest voxel
of its box, corners sorted by coordinates. So a fragment does not depend on the box, on the order of
triangles, or on where a triangle's corner list starts.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel, part
from gstream.kernels.clip import (
    AREA_UNITS,
    CORNERS,
    area_of,
    clip_between,
    cut_below,
    moments_of,
    square_below,
)
from gstream.kernels.outline import cover_box
from gstream.kernels.overlap import (
    CEIL,
    CENTRE_CEIL,
    CENTRE_FLOOR,
    FLOOR,
    N_NEGATIVE,
    N_POSITIVE,
    PLANE_SLOTS,
    dominant_axis,
    face_mask,
    plane_out_of_reach,
    plane_range,
    prepare_direction,
    prepare_edges,
    prepare_normal,
    prepare_plane,
)
from gstream.kernels.packet_frame import pick
from gstream.kernels.targets import meets_centre_lines, meets_diagonals, prepare_diagonals

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

CONSERVATIVE, SIX, TWENTY_SIX = 0, 6, 26
SLAB_FRAGMENTS = 4096  # room for a slab of 256 columns: closed ties add 2 voxels to a column
BUFFER_FRAGMENTS = 16_448
NUMBER = np.int64  # of corners and thresholds; the accuracy report has a form with floats
COVERED = 1 << 12  # voxels of a box up to which all its areas are made at once, 64 KB
FEW_VOXELS = 4  # along w: up to here every voxel is tested, above the range is computed


@part
def sort_corners(corners: I64, order: I64) -> int:
    """Order a triangle's corners by (x, y, z); -1 where that mirrors it, else 1.

    order : (3,) i8   out: which input corner stands at each sorted place
    """
    order[0], order[1], order[2] = 0, 1, 2
    turn = 1
    for a, b in ((0, 1), (1, 2), (0, 1)):
        p, q = order[a], order[b]
        swap = False
        for c in range(3):
            if corners[p, c] != corners[q, c]:
                swap = corners[p, c] > corners[q, c]
                break
        if swap:
            order[a], order[b] = q, p
            turn = -turn
    return turn


@part
def load_triangle(corners: I64, k: int, closed: bool, tri: I64, box: I64, order: I64) -> int:
    """Move a triangle to its own frame, corners in ascending order of (x, y, z).

    corners : (3, 3) i8   snap units, relative to the box being filled
    tri : (3, 3) i8   out: sorted corners relative to voxel `box[0]`'s low corner
    box : (3, 3) i8   out: rows base voxel, then first and last voxel met relative to the base
    order : (3,) i8   out: which input corner stands at each sorted place
    returns : int   -1 where sorting mirrored the triangle, else 1
    """
    for c in range(3):
        low = min(corners[0, c], corners[1, c], corners[2, c])
        high = max(corners[0, c], corners[1, c], corners[2, c])
        base = low >> k
        box[0, c] = base
        box[1, c] = -((-low) >> k) - 1 - base if closed else 0
        box[2, c] = (high >> k) - base
    turn = sort_corners(corners, order)
    for a in range(3):
        for c in range(3):
            tri[a, c] = corners[order[a], c] - (box[0, c] << k)
    return turn


@part
def prepare_gradients(
    tri: I64, order: I64, values: F64, u: int, v: int, scale: float, flat: bool, gradients: F64
) -> None:
    """Each channel as an affine function of (u, v): g0 + gu*u + gv*v, or the mean where flat.

    values : (3, channels) f8   by input corner
    gradients : (channels, 5) f8   out: g0, gu, gv, smallest, largest corner value
    """
    u0, v0 = tri[0, u] * scale, tri[0, v] * scale
    a, b = (tri[1, u] - tri[0, u]) * scale, (tri[1, v] - tri[0, v]) * scale
    c, d = (tri[2, u] - tri[0, u]) * scale, (tri[2, v] - tri[0, v]) * scale
    det = a * d - b * c
    for ch in range(values.shape[1]):
        first = values[order[0], ch]
        second = values[order[1], ch] - first
        third = values[order[2], ch] - first
        gradients[ch, 3] = first + min(0.0, second, third)
        gradients[ch, 4] = first + max(0.0, second, third)
        if flat:
            gradients[ch, 0] = (values[0, ch] + values[1, ch] + values[2, ch]) / 3.0
            gradients[ch, 1] = 0.0
            gradients[ch, 2] = 0.0
        else:
            gu = (second * d - third * b) / det
            gv = (third * a - second * c) / det
            gradients[ch, 0] = first - gu * u0 - gv * v0
            gradients[ch, 1] = gu
            gradients[ch, 2] = gv


@part
def clip_to_room(box: I64, room: tuple[int, int, int]) -> bool:
    """Limit a triangle's voxels to those of the box being filled; False when none are left."""
    for c in range(3):
        box[1, c] = max(box[1, c], -box[0, c])
        box[2, c] = min(box[2, c], room[c] - 1 - box[0, c])
        if box[1, c] > box[2, c]:
            return False
    return True


@part
def mean_channels(gradients: F64, u: float, v: float, means: F64) -> None:
    """Channels at a fragment's centroid (u, v), within the range of the triangle's corners."""
    for c in range(means.shape[0]):
        value = gradients[c, 0] + gradients[c, 1] * u + gradients[c, 2] * v
        means[c] = min(max(value, gradients[c, 3]), gradients[c, 4])


@kernel
def emit(
    corners: I64,
    values: F64,
    chosen: NDArray[np.int32],
    rules: tuple[int, int, bool, bool],
    room: tuple[int, int, int],
    resume: tuple[int, int],
    spread: NDArray[np.uint32],
    normals: F64,
    masks: NDArray[np.uint8],
    assigned: NDArray[np.bool_],
    keys: NDArray[np.uint32],
    owners: NDArray[np.int32],
    hits: NDArray[np.bool_],
    areas: F64,
    channels: F64,
) -> tuple[int, int, int]:
    """Fragments of a batch of triangles inside one box, until the buffer is full or the batch ends.

    corners : (n, 3, 3) i8   snap units relative to the box's low corner
    values : (n, 3, c) f8   channels at the corners (c may be 0)
    chosen : (n,) i4   triangles in the order in which to take them
    rules : (snap bits, mode, closed ties, faces both)
    room : voxels of the box along x, y, z, at most 256 each
    resume : (place in `chosen`, slab) to go on with; slab -1 = the triangle's start
    spread : (256,) u4   Morton code of (i, 0, 0)
    normals, masks, assigned : (n, 4) f8, (n,) u1, (n,) bool   out, per triangle; column 0 of the
        normals is 1, the share of the area itself, and stays; the others are VECTOR_UNITS long
    keys, owners, hits, areas : (b,) u4, i4, bool, f8   out: Morton code in the box, triangle,
        target met, area in accumulator units
    channels : (b, c) f8   out: channel means over the fragment
    returns : (place, slab, fragments)   where to resume, and how many fragments were written
    source : numerics.md section 2 and 3; thesis 3.1.1
    """
    # One long function on purpose: the compiler knows that arrays made here do not overlap. With
    # slabs and columns in parts of their own, large and coloured triangles took twice the time.
    k, mode, closed, both = rules
    place, slab = resume
    scale = 1.0 / (1 << k)
    has_channels = values.shape[2] > 0
    tri = np.empty((3, 3), NUMBER)
    box = np.empty((3, 3), np.int64)
    order = np.empty(3, np.int64)
    plane = np.empty(PLANE_SLOTS, NUMBER)
    edges = np.empty((3, 3, 3), NUMBER)
    centres = np.empty((3, 3), NUMBER)
    lines = np.empty((4, 3, 4), NUMBER)
    ends = np.empty((4, 3), NUMBER)
    voxel = np.empty(3, np.int64)
    whole_u, whole_v = np.empty(3), np.empty(3)
    strip_u, strip_v = np.empty(CORNERS), np.empty(CORNERS)
    column_u, column_v = np.empty(CORNERS), np.empty(CORNERS)
    spare_u, spare_v = np.empty(CORNERS), np.empty(CORNERS)
    heights = np.empty(CORNERS)
    gradients = np.empty((values.shape[2], 5))
    covers = np.empty((2, 0 if has_channels or closed else COVERED))
    count = 0
    while place < chosen.shape[0]:
        t = np.int64(chosen[place])
        turn = load_triangle(corners[t], k, closed, tri, box, order)
        extent_x, extent_y, extent_z = box[2, 0] + 1, box[2, 1] + 1, box[2, 2] + 1
        if not clip_to_room(box, room):
            place, slab = place + 1, -1
            continue
        prepare_normal(tri, plane)
        if plane_out_of_reach(plane, tri, k, box[1]):
            place, slab = place + 1, -1
            continue
        prepare_plane(tri, k, closed, box[1], plane)
        prepare_edges(tri, plane, k, closed, edges, centres)
        if mode == TWENTY_SIX:
            prepare_diagonals(tri, plane, k, closed, lines, ends)
        w = dominant_axis(plane, box)
        u, v = (w + 1) % 3, (w + 2) % 3
        length = prepare_direction(plane, turn, normals[t, 1:])
        masks[t] = face_mask(plane, turn, both)
        flat = plane[w] == 0
        inverse = 0.0 if flat else 1.0 / np.float64(plane[w])
        factor = 0.0 if flat else AREA_UNITS * length * abs(inverse)
        slope_u, slope_v = plane[u] * inverse, plane[v] * inverse
        for a in range(3):
            whole_u[a] = tri[a, u] * scale
            whole_v[a] = tri[a, v] * scale
        height_0 = tri[0, w] * scale + slope_u * whole_u[0] + slope_v * whole_v[0]
        if has_channels:
            prepare_gradients(tri, order, values[t], u, v, scale, flat, gradients)
        covered = not flat and extent_x * extent_y * extent_z <= covers.shape[1]
        wide, long = pick(u, extent_x, extent_y, extent_z), pick(v, extent_x, extent_y, extent_z)
        if covered:
            size = wide, long, pick(w, extent_x, extent_y, extent_z)
            cover_box(tri, k, u, v, w, size, covers)
        # Columns inside the triangle: no edge decides, and their squares are cut in a closed form.
        steep, gentle = max(abs(slope_u), abs(slope_v)), min(abs(slope_u), abs(slope_v))
        falls = max(slope_u, 0.0) + max(slope_v, 0.0)
        quick = steep > 0.0 and not has_channels
        quick = quick and (mode == CONSERVATIVE or (mode == SIX and not closed))
        over_u, under_u = max(plane[u], 0) - plane[CENTRE_CEIL + u], min(plane[u], 0)
        over_v, under_v = max(plane[v], 0) - plane[CENTRE_CEIL + v], min(plane[v], 0)
        over_w, under_w = max(plane[w], 0) - plane[CENTRE_CEIL + w], min(plane[w], 0)
        under_u, under_v = under_u - plane[CENTRE_FLOOR + u], under_v - plane[CENTRE_FLOOR + v]
        under_w = under_w - plane[CENTRE_FLOOR + w]
        # Thresholds and steps in locals: read from the arrays they cost a third of the loop.
        low_w, size_w = box[1, w], box[2, w] - box[1, w] + 1
        a0, a1, a2 = edges[w, 0, 0], edges[w, 1, 0], edges[w, 2, 0]
        b0, b1, b2 = edges[w, 0, 1], edges[w, 1, 1], edges[w, 2, 1]
        c0, c1, c2 = edges[w, 0, 2], edges[w, 1, 2], edges[w, 2, 2]
        f0, f1, f2 = edges[u, 0, 0], edges[u, 1, 0], edges[u, 2, 0]
        g0, g1, g2 = edges[u, 0, 1], edges[u, 1, 1], edges[u, 2, 1]
        h0, h1, h2 = edges[u, 0, 2], edges[u, 1, 2], edges[u, 2, 2]
        p0, p1, p2 = edges[v, 0, 0], edges[v, 1, 0], edges[v, 2, 0]
        q0, q1, q2 = edges[v, 0, 1], edges[v, 1, 1], edges[v, 2, 1]
        r0, r1, r2 = edges[v, 0, 2], edges[v, 1, 2], edges[v, 2, 2]
        n_w = plane[w]
        above, below = plane[N_POSITIVE] - plane[CEIL], plane[N_NEGATIVE] - plane[FLOOR]
        i = box[1, u] if slab < 0 else slab
        while i <= box[2, u]:
            if count + SLAB_FRAGMENTS > keys.shape[0]:
                return place, i, count
            strip_corners = -1
            for j in range(box[1, v], box[2, v] + 1):
                inside_0 = a0 * i + b0 * j + c0
                inside_1 = a1 * i + b1 * j + c1
                inside_2 = a2 * i + b2 * j + c2
                if inside_0 < 0 or inside_1 < 0 or inside_2 < 0:
                    continue
                full = (
                    inside_0 > abs(a0) + abs(b0)
                    and inside_1 > abs(a1) + abs(b1)
                    and inside_2 > abs(a2) + abs(b2)
                )
                first, last = np.int64(0), size_w - 1
                across = plane[u] * (i - box[1, u]) + plane[v] * (j - box[1, v])
                if size_w > FEW_VOXELS and not flat:
                    first, last = plane_range(plane, inverse, w, across, size_w)
                if full and quick:
                    lowest = height_0 - slope_u * i - slope_v * j - falls
                    code = spread[i + box[0, u]] << np.uint32(u)
                    code |= spread[j + box[0, v]] << np.uint32(v)
                    lower = square_below(low_w + first - lowest, steep, gentle)
                    for step in range(first, last + 1):
                        upper = square_below(low_w + step + 1 - lowest, steep, gentle)
                        area, lower = upper - lower, upper
                        value = across + n_w * step
                        if value + above < 0 or value + below > 0:
                            continue
                        hit = (
                            mode == CONSERVATIVE
                            or (n_w != 0 and value + over_w >= 0 and value + under_w <= 0)
                            or (plane[u] != 0 and value + over_u >= 0 and value + under_u <= 0)
                            or (plane[v] != 0 and value + over_v >= 0 and value + under_v <= 0)
                        )
                        assigned[t] |= hit
                        keys[count] = code | spread[low_w + step + box[0, w]] << np.uint32(w)
                        owners[count] = t
                        hits[count] = hit
                        areas[count] = area * factor
                        count += 1
                    continue
                corner_count = -1
                measured = np.int64(-2)  # the l that `lower` belongs to
                total, lower = 0.0, 0.0
                total_u, total_v, lower_u, lower_v = 0.0, 0.0, 0.0, 0.0
                lowest, highest = 0.0, 0.0
                for step in range(first, last + 1):
                    if across + above + n_w * step < 0 or across + below + n_w * step > 0:
                        continue
                    l = low_w + step
                    if not full and (
                        f0 * j + g0 * l + h0 < 0
                        or f1 * j + g1 * l + h1 < 0
                        or f2 * j + g2 * l + h2 < 0
                        or p0 * l + q0 * i + r0 < 0
                        or p1 * l + q1 * i + r1 < 0
                        or p2 * l + q2 * i + r2 < 0
                    ):
                        continue
                    if corner_count < 0 and not covered:
                        corner_count = 0
                        if full:
                            column_u[0], column_v[0] = i, j
                            column_u[1], column_v[1] = i + 1, j
                            column_u[2], column_v[2] = i + 1, j + 1
                            column_u[3], column_v[3] = i, j + 1
                            corner_count = 4
                        elif not flat:
                            if strip_corners < 0:
                                strip_corners = clip_between(
                                    whole_u, whole_v, 3, np.float64(i),
                                    spare_u, spare_v, strip_u, strip_v,
                                )  # fmt: skip
                            if strip_corners > 2:
                                corner_count = clip_between(
                                    strip_v, strip_u, strip_corners, np.float64(j),
                                    spare_v, spare_u, column_v, column_u,
                                )  # fmt: skip
                        if corner_count < 3:
                            corner_count = 0
                        else:
                            lowest, highest = np.inf, -np.inf
                            for a in range(corner_count):
                                height = height_0 - slope_u * column_u[a] - slope_v * column_v[a]
                                heights[a] = height
                                lowest = min(lowest, height)
                                highest = max(highest, height)
                            total = area_of(column_u, column_v, corner_count)
                            if has_channels:
                                total_u, total_v = moments_of(column_u, column_v, corner_count)
                    # Area between two heights: the difference of two cumulative values, each a
                    # pure function of the column's polygon and l.
                    area, area_u, area_v = total, total_u, total_v
                    if covered:
                        area = covers[0, (l * long + j) * wide + i]
                    elif corner_count:
                        if highest > l + 1:
                            upper, upper_u, upper_v = 0.0, 0.0, 0.0
                            kept = cut_below(
                                column_u, column_v, heights, corner_count, l + 1.0, spare_u, spare_v
                            )
                            if kept:
                                upper = area_of(spare_u, spare_v, kept)
                                if has_channels:
                                    upper_u, upper_v = moments_of(spare_u, spare_v, kept)
                            area, area_u, area_v = upper, upper_u, upper_v
                        if lowest < l:
                            if measured != l:
                                lower, lower_u, lower_v = 0.0, 0.0, 0.0
                                kept = cut_below(
                                    column_u, column_v, heights, corner_count, np.float64(l),
                                    spare_u, spare_v,
                                )  # fmt: skip
                                if kept:
                                    lower = area_of(spare_u, spare_v, kept)
                                    if has_channels:
                                        lower_u, lower_v = moments_of(spare_u, spare_v, kept)
                            area -= lower
                            area_u -= lower_u
                            area_v -= lower_v
                        if highest > l + 1:
                            lower, lower_u, lower_v = upper, upper_u, upper_v
                            measured = l + 1
                    voxel[u], voxel[v], voxel[w] = i, j, l
                    hit = True
                    if mode != CONSERVATIVE:
                        value = across + n_w * step
                        if mode == SIX:
                            hit = meets_centre_lines(
                                tri, plane, edges, centres, k, closed, voxel, value
                            )
                        else:
                            hit = meets_diagonals(tri, plane, lines, ends, k, closed, voxel, value)
                    assigned[t] |= hit
                    keys[count] = (
                        spread[voxel[0] + box[0, 0]]
                        | (spread[voxel[1] + box[0, 1]] << np.uint32(1))
                        | (spread[voxel[2] + box[0, 2]] << np.uint32(2))
                    )
                    owners[count] = t
                    hits[count] = hit
                    areas[count] = abs(area) * factor
                    if has_channels:
                        mean_u, mean_v = i + 0.5, j + 0.5
                        if area != 0.0:
                            mean_u, mean_v = area_u / area, area_v / area
                        mean_channels(gradients, mean_u, mean_v, channels[count])
                    count += 1
            i += 1
        place, slab = place + 1, -1
    return place, -1, count
