"""Drawing voxels as exact cubes into a depth buffer: each pixel's ray against each voxel under it.

A camera is 26 numbers, `camera` below: float64, index space of level 0 (voxel (0,0,0) is [0,1]^3).
camera[0:12]   3 x 4, row-major: index space -> camera space (x right, y down, z away);
               x and y in pixels at z = 1
camera[12:15]  the eye, index space
camera[15:24]  3 x 3, row-major: pixel (px, py, 1) -> ray direction, index space, 1 long in z
camera[24:26]  the pixel that the eye looks at, px and py
So a pixel's point at depth z is eye + z * direction.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
U8 = NDArray[np.uint8]


@kernel
def footprint(camera: F64, low: F64, high: F64) -> tuple[int, int, int, int, float]:
    """The pixels that a box may cover, and its nearest depth.

    camera : (26,) float64 as above; low, high : (3,) float64, index space
    returns: x0, x1, y0, y1 pixel ranges (half-open, not clamped to the picture), nearest depth
    errors : none; a box that reaches behind the eye covers everything at depth 0
    source : interval arithmetic over the eight corners of a perspective projection
    """
    centre, half = np.empty(3), np.empty(3)
    for row in range(3):
        centre[row], half[row] = camera[4 * row + 3], 0.0
        for axis in range(3):
            m = camera[4 * row + axis]
            centre[row] += m * (low[axis] + high[axis]) * 0.5
            half[row] += abs(m) * (high[axis] - low[axis]) * 0.5
    near, far = centre[2] - half[2], centre[2] + half[2]
    if near <= 0.0:
        return -(1 << 30), 1 << 30, -(1 << 30), 1 << 30, 0.0
    left, right = centre[0] - half[0], centre[0] + half[0]
    top, bottom = centre[1] - half[1], centre[1] + half[1]
    x0 = left / (near if left < 0 else far) + camera[24]
    x1 = right / (near if right > 0 else far) + camera[24]
    y0 = top / (near if top < 0 else far) + camera[25]
    y1 = bottom / (near if bottom > 0 else far) + camera[25]
    return int(np.floor(x0)), int(np.ceil(x1)), int(np.floor(y0)), int(np.ceil(y1)), near


@kernel
def is_hidden(depth: F32, camera: F64, low: F64, high: F64) -> bool:
    """True when drawing what lies in the box changes no pixel: outside the picture, or behind.

    depth : (height, width) float32, inf where nothing is drawn
    camera : (26,) float64; low, high : (3,) float64, index space
    returns: bool
    errors : none
    source : Greene et al., Hierarchical Z-Buffer Visibility (1993), with a flat buffer
    """
    x0, x1, y0, y1, near = footprint(camera, low, high)
    for y in range(max(y0, 0), min(y1, depth.shape[0])):
        for x in range(max(x0, 0), min(x1, depth.shape[1])):
            if depth[y, x] > near:
                return False
    return True


@kernel
def ray_depth(camera: F64, px: int, py: int, low: F64, high: F64) -> float:
    """Depth at which the ray of a pixel centre enters a box; inf when it misses.

    camera : (26,) float64; px, py : int pixel; low, high : (3,) float64, index space
    returns: float64
    errors : none
    source : Kay and Kajiya, Ray Tracing Complex Scenes (1986), slabs
    """
    enter, leave = 0.0, np.inf
    x, y = px + 0.5, py + 0.5
    for axis in range(3):
        way = camera[15 + 3 * axis] * x + camera[16 + 3 * axis] * y + camera[17 + 3 * axis]
        if way == 0.0:
            if not low[axis] <= camera[12 + axis] <= high[axis]:
                return np.inf
            continue
        one, two = (low[axis] - camera[12 + axis]) / way, (high[axis] - camera[12 + axis]) / way
        enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
    return enter if enter <= leave else np.inf


@kernel
def splat(
    camera: F64,
    positions: I64,
    edge: int,
    normals: F32,
    colours: U8,
    depth: F32,
    normal: F32,
    colour: U8,
) -> int:
    """Draw voxels as cubes; the nearest wins, and the first drawn of equals.

    camera : (26,) float64
    positions : (n, 3) int64 low corners, index space of level 0; edge : of a voxel there
    normals : (n, 3) float32, zero = no direction; colours : (n, 3) uint8, (0, 3) = none
    depth : (h, w) float32, normal : (h, w, 3) float32, colour : (h, w, 3) uint8, drawn in place
    returns: int   voxels that changed at least one pixel when they were drawn
    errors : none
    source : exact cubes by slabs; no ray slips through a surface that is 6-separating
    """
    low, high = np.empty(3), np.empty(3)
    drawn = 0
    for i in range(positions.shape[0]):
        for axis in range(3):
            low[axis] = positions[i, axis]
            high[axis] = positions[i, axis] + edge
        x0, x1, y0, y1, near = footprint(camera, low, high)
        seen = False
        for y in range(max(y0, 0), min(y1, depth.shape[0])):
            for x in range(max(x0, 0), min(x1, depth.shape[1])):
                if depth[y, x] <= near:
                    continue
                z = np.float32(ray_depth(camera, x, y, low, high))
                if z < depth[y, x]:
                    depth[y, x] = z
                    normal[y, x] = normals[i]
                    if colours.shape[0]:
                        colour[y, x] = colours[i]
                    seen = True
        drawn += seen
    return drawn
