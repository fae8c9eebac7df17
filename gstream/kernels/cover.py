"""Areas of small triangles in all voxels of their boxes, by walking along outlines, in packets.

A triangle seen along its dominant axis w is cut by the planes w = 1, 2, ... into layers. The area
of a layer inside a square (i, j) is a sum over the pieces of the layer's outline: a piece that
rises by dv at mean place u adds dv * (i + 1 - u) to its own square and dv to all squares with
larger i (Green's theorem; the way font rasterisers fill). Outlines are the triangle's edges, walked
once, and the level segments between layers, which count for the layer below and, backwards, for the
one above. So a voxel costs the few pieces in it, not two clipped polygons. First moments, for means
of channels, are sums over the same pieces.

A walk takes as many steps as the largest box of the packet may need; a lane that has arrived adds
zeros. Steps are made for all lanes at once, then added up lane by lane.

Errors are about 1e-15 of a voxel face, and 2^-40 where a corner lies on the lattice.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part
from gstream.kernels.lanes import LANES, at

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

LATE = 2.0**-40  # crossings come late, so that no walk to the lattice enters the voxel beyond

# Rows of `reals`: part of the walk done, distance to the square's right side, ...
AT, RIGHT = 0, 1
NEXT_U, NEXT_V, NEXT_W = 2, 3, 4  # part of the walk before the next plane of the lattice
EACH_U, EACH_V, EACH_W = 5, 6, 7  # between two
ALONG_U, ALONG_V = 8, 9  # extent of the walk
OWN, BEYOND = 10, 11  # of the piece just made: area in its square, and in those that follow
UP, RISING = 12, 13  # distance to the square's low side, extent along v whatever the sign of pieces
OWN_U, OWN_V, BEYOND_V = 14, 15, 16  # moments of the piece about the low corners of the squares
WALK_ROWS = 17
# Rows of `slots`, places of `own` and `beyond`.
SLOT, STEP_U, STEP_V, STEP_W, MADE = 0, 1, 2, 3, 4
SLOT_ROWS = 5


@part
def cover_edge(
    words: I64, k: int, start: int, end: int, size: tuple[int, int, int],
    reals: F64, slots: I64, own: F64, beyond: F64, moments: F64,
) -> None:  # fmt: skip
    """Add the pieces of the edges from corner `start` to corner `end`.

    words : rows 3 * corner + axis of snap units
    size : voxels of the largest box, along u, v, w
    reals, slots : rows of the walk
    own, beyond : (voxels * LANES,) f8   areas of a lane's voxel ((l * long) + j) * wide + i, and of
        all that follow it in its row, added to
    moments : (3 * voxels * LANES,) f8 or (0,)   along u, along v, along v of those that follow
    """
    start_edge(words, k, start, end, size[0], size[0] * size[1], reals, slots)
    for _ in range(size[0] + size[1] + size[2] - 2):
        if moments.size:
            measure_moments(reals)
        step_edge(reals, slots)
        if moments.size:
            add_moments(reals, slots, size[0] * size[1] * size[2] * LANES, 0, moments)
        for lane in range(LANES):
            place = np.uint64(slots[at(MADE, lane)])
            own[place] += reals[at(OWN, lane)]
            beyond[place] += reals[at(BEYOND, lane)]


@part
def cover_level(
    words: I64, k: int, level: int, size: tuple[int, int, int],
    reals: F64, slots: I64, own: F64, beyond: F64, moments: F64,
) -> None:  # fmt: skip
    """Add the segments between layers level - 1 and level; see `cover_edge`."""
    layer = size[0] * size[1]
    start_level(words, k, level, size[0], layer, reals, slots)
    for _ in range(size[0] + size[1] - 1):
        if moments.size:
            measure_moments(reals)
        step_level(reals, slots)
        if moments.size:
            add_moments(reals, slots, layer * size[2] * LANES, layer * LANES, moments)
        for lane in range(LANES):
            below = np.uint64(slots[at(MADE, lane)])
            above = below + np.uint64(layer * LANES)
            own[below] += reals[at(OWN, lane)]
            beyond[below] += reals[at(BEYOND, lane)]
            own[above] -= reals[at(OWN, lane)]
            beyond[above] -= reals[at(BEYOND, lane)]


@part
def measure_moments(reals: F64) -> None:
    """Rows of the moments of the piece that the next step makes, and UP after it."""
    for lane in range(LANES):
        done, right, up = reals[at(AT, lane)], reals[at(RIGHT, lane)], reals[at(UP, lane)]
        next_v, along = reals[at(NEXT_V, lane)], reals[at(ALONG_U, lane)]
        rising = reals[at(RISING, lane)]
        to = min(min(reals[at(NEXT_U, lane)], next_v), min(reals[at(NEXT_W, lane)], 1.0))
        rise = (to - done) * reals[at(ALONG_V, lane)]
        # From the square's right side and low side, at the piece's two ends.
        r0, r1 = right - done * along, right - to * along
        y0, y1 = up + done * rising, up + to * rising
        reals[at(OWN_U, lane)] = rise * (0.5 * (r0 + r1) - (r0 * r0 + r0 * r1 + r1 * r1) / 6.0)
        reals[at(OWN_V, lane)] = rise * (2.0 * (y0 * r0 + y1 * r1) + y0 * r1 + y1 * r0) / 6.0
        reals[at(BEYOND_V, lane)] = rise * 0.5 * (y0 + y1)
        aside = 1.0 if rising >= 0.0 else -1.0
        reals[at(UP, lane)] = up - (aside if next_v <= to else 0.0)


@part
def add_moments(reals: F64, slots: I64, voxels: int, above: int, moments: F64) -> None:
    """Add the piece's moments to its voxel's, and subtract them from those `above` places on."""
    for lane in range(LANES):
        place = np.uint64(slots[at(MADE, lane)])
        for row in range(3):
            piece = reals[at(OWN_U + row, lane)]
            moments[place] += piece
            if above:
                moments[place + np.uint64(above)] -= piece
            place += np.uint64(voxels)


@part
def crossings(start: float, extent: float, cell: int) -> tuple[float, float]:
    """Of a walk along one axis: the part of it before the first lattice plane, and between two."""
    up = 1.0 if extent >= 0.0 else 0.0
    each = 1.0 / extent
    return (np.float64(cell) - start + up) * each + LATE, abs(each)


@part
def start_edge(
    words: I64, k: int, start: int, end: int, wide: int, layer: int, reals: F64, slots: I64
) -> None:
    """Rows of the walk from corner to corner."""
    scale = 1.0 / (1 << k)
    for lane in range(LANES):
        first_u, first_v = words[at(3 * start, lane)], words[at(3 * start + 1, lane)]
        first_w = words[at(3 * start + 2, lane)]
        u, v, w = first_u * scale, first_v * scale, first_w * scale
        along_u = words[at(3 * end, lane)] * scale - u
        along_v = words[at(3 * end + 1, lane)] * scale - v
        along_w = words[at(3 * end + 2, lane)] * scale - w
        i, j, l = first_u >> k, first_v >> k, first_w >> k
        next_u, each_u = crossings(u, along_u, i)
        next_v, each_v = crossings(v, along_v, j)
        next_w, each_w = crossings(w, along_w, l)
        reals[at(AT, lane)] = 0.0
        reals[at(RIGHT, lane)] = np.float64(i + 1) - u
        reals[at(NEXT_U, lane)], reals[at(EACH_U, lane)] = next_u, each_u
        reals[at(NEXT_V, lane)], reals[at(EACH_V, lane)] = next_v, each_v
        reals[at(NEXT_W, lane)], reals[at(EACH_W, lane)] = next_w, each_w
        reals[at(ALONG_U, lane)], reals[at(ALONG_V, lane)] = along_u, along_v
        reals[at(UP, lane)], reals[at(RISING, lane)] = v - np.float64(j), along_v
        slots[at(SLOT, lane)] = (l * layer + j * wide + i) * LANES + lane
        slots[at(STEP_U, lane)] = LANES if along_u >= 0.0 else -LANES
        slots[at(STEP_V, lane)] = wide * LANES if along_v >= 0.0 else -wide * LANES
        slots[at(STEP_W, lane)] = layer * LANES if along_w >= 0.0 else -layer * LANES


@part
def step_edge(reals: F64, slots: I64) -> None:
    """Walk on to the next lattice plane, or to the end; at the end nothing changes."""
    for lane in range(LANES):
        done, right = reals[at(AT, lane)], reals[at(RIGHT, lane)]
        next_u, next_v = reals[at(NEXT_U, lane)], reals[at(NEXT_V, lane)]
        next_w = reals[at(NEXT_W, lane)]
        along = reals[at(ALONG_U, lane)]
        slot = slots[at(SLOT, lane)]
        to = min(min(next_u, next_v), min(next_w, 1.0))
        rise = (to - done) * reals[at(ALONG_V, lane)]
        reals[at(OWN, lane)] = rise * (right - 0.5 * (done + to) * along)
        reals[at(BEYOND, lane)] = rise
        slots[at(MADE, lane)] = slot
        over_u, over_v, over_w = next_u <= to, next_v <= to, next_w <= to
        slot += slots[at(STEP_U, lane)] if over_u else 0
        slot += slots[at(STEP_V, lane)] if over_v else 0
        slot += slots[at(STEP_W, lane)] if over_w else 0
        slots[at(SLOT, lane)] = slot
        reals[at(AT, lane)] = to
        aside = 1.0 if along >= 0.0 else -1.0
        reals[at(RIGHT, lane)] = right + (aside if over_u else 0.0)
        reals[at(NEXT_U, lane)] = next_u + (reals[at(EACH_U, lane)] if over_u else 0.0)
        reals[at(NEXT_V, lane)] = next_v + (reals[at(EACH_V, lane)] if over_v else 0.0)
        reals[at(NEXT_W, lane)] = next_w + (reals[at(EACH_W, lane)] if over_w else 0.0)


@part
def start_level(
    words: I64, k: int, level: int, wide: int, layer: int, reals: F64, slots: I64
) -> None:
    """Rows of the walk where triangles cross a level; of no length where they do not."""
    scale = 1.0 / (1 << k)
    for lane in range(LANES):
        u0, v0 = words[at(0, lane)] * scale, words[at(1, lane)] * scale
        u1, v1 = words[at(3, lane)] * scale, words[at(4, lane)] * scale
        u2, v2 = words[at(6, lane)] * scale, words[at(7, lane)] * scale
        l0, l1, l2 = words[at(2, lane)], words[at(5, lane)], words[at(8, lane)]
        w0, w1, w2 = l0 * scale, l1 * scale, l2 * scale
        high_0, high_1, high_2 = (l0 >> k) >= level, (l1 >> k) >= level, (l2 >> k) >= level
        crossed = (high_0 | high_1 | high_2) & ((not high_0) | (not high_1) | (not high_2))
        # The corner alone on its side, the one before it and the one after.
        zero, one = high_1 == high_2, high_0 == high_2
        odd_u = u0 if zero else (u1 if one else u2)
        odd_v = v0 if zero else (v1 if one else v2)
        odd_w = w0 if zero else (w1 if one else w2)
        odd_high = high_0 if zero else (high_1 if one else high_2)
        before_u = u2 if zero else (u0 if one else u1)
        before_v = v2 if zero else (v0 if one else v1)
        before_w = w2 if zero else (w0 if one else w1)
        after_u = u1 if zero else (u2 if one else u0)
        after_v = v1 if zero else (v2 if one else v0)
        after_w = w1 if zero else (w2 if one else w0)
        into = (level - before_w) / (odd_w - before_w)
        out = (level - odd_w) / (after_w - odd_w)
        u = before_u + into * (odd_u - before_u) if crossed else 0.0
        v = before_v + into * (odd_v - before_v) if crossed else 0.0
        along_u = odd_u + out * (after_u - odd_u) - u if crossed else 0.0
        along_v = odd_v + out * (after_v - odd_v) - v if crossed else 0.0
        i, j = np.int64(u), np.int64(v)
        next_u, each_u = crossings(u, along_u, i)
        next_v, each_v = crossings(v, along_v, j)
        reals[at(AT, lane)] = 0.0
        reals[at(RIGHT, lane)] = np.float64(i + 1) - u
        reals[at(NEXT_U, lane)], reals[at(EACH_U, lane)] = next_u, each_u
        reals[at(NEXT_V, lane)], reals[at(EACH_V, lane)] = next_v, each_v
        reals[at(NEXT_W, lane)] = 1.0
        reals[at(ALONG_U, lane)] = along_u
        reals[at(ALONG_V, lane)] = along_v if odd_high else -along_v
        reals[at(UP, lane)], reals[at(RISING, lane)] = v - np.float64(j), along_v
        slots[at(SLOT, lane)] = ((level - 1) * layer + j * wide + i) * LANES + lane
        slots[at(STEP_U, lane)] = LANES if along_u >= 0.0 else -LANES
        slots[at(STEP_V, lane)] = wide * LANES if along_v >= 0.0 else -wide * LANES


@part
def step_level(reals: F64, slots: I64) -> None:
    """As `step_edge`, in the plane of a level."""
    for lane in range(LANES):
        done, right = reals[at(AT, lane)], reals[at(RIGHT, lane)]
        next_u, next_v = reals[at(NEXT_U, lane)], reals[at(NEXT_V, lane)]
        along = reals[at(ALONG_U, lane)]
        slot = slots[at(SLOT, lane)]
        to = min(min(next_u, next_v), 1.0)
        rise = (to - done) * reals[at(ALONG_V, lane)]
        reals[at(OWN, lane)] = rise * (right - 0.5 * (done + to) * along)
        reals[at(BEYOND, lane)] = rise
        slots[at(MADE, lane)] = slot
        over_u, over_v = next_u <= to, next_v <= to
        slot += slots[at(STEP_U, lane)] if over_u else 0
        slot += slots[at(STEP_V, lane)] if over_v else 0
        slots[at(SLOT, lane)] = slot
        reals[at(AT, lane)] = to
        aside = 1.0 if along >= 0.0 else -1.0
        reals[at(RIGHT, lane)] = right + (aside if over_u else 0.0)
        reals[at(NEXT_U, lane)] = next_u + (reals[at(EACH_U, lane)] if over_u else 0.0)
        reals[at(NEXT_V, lane)] = next_v + (reals[at(EACH_V, lane)] if over_v else 0.0)
