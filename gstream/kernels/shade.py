"""From what a picture's pixels see (depth, normal, colour) to light: occlusion, shadow, lamps.

Camera space: x right, y down, z away from the eye. `lens` is (3,) float64: focal length in pixels,
and the pixel that the eye looks at. This is for looking at; nothing of it enters a file of ours.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
U8 = NDArray[np.uint8]
Vector = tuple[float, float, float]

SPIRAL_TURNS = 7  # coprime to the sample count, so that the samples spread over all directions

# camera space, towards the lamp; linear light
KEY_WAY = (-0.50, -0.66, -0.56)
FILL_WAY = (0.83, -0.10, -0.55)
RIM_WAY = (0.35, -0.55, 0.76)
HALF_WAY = (-0.283, -0.374, -0.883)  # between the key lamp and the eye
KEY = (1.22, 1.14, 1.03)
FILL = (0.20, 0.25, 0.33)
RIM = (0.55, 0.58, 0.62)
SKY = (0.36, 0.40, 0.46)
GROUND = (0.20, 0.17, 0.15)
GLOSS = 0.10


@kernel
def occlusion(
    depth: F32,
    normal: F32,
    turn: F64,
    lens: F64,
    radius: float,
    bias: float,
    samples: int,
    open_sky: F32,
) -> None:
    """How much of the sky near each pixel is not blocked by its surroundings.

    depth : (h, w) float32, inf = background; normal : (h, w, 3) float32, grid axes
    turn : (3, 3) float64, grid -> camera; lens : (3,) float64; radius, bias : world units
    open_sky : (h, w) float32, multiplied in place by 0 (closed) ... 1 (open)
    returns: nothing
    errors : none
    source : McGuire, Mara, Luebke, Scalable Ambient Obscurance (HPG 2012), section 2.3
    """
    height, width = depth.shape
    for y in range(height):
        for x in range(width):
            z = np.float64(depth[y, x])
            if z == np.inf:
                continue
            n = _camera_normal(normal, turn, x, y)
            if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
                continue
            px = (x + 0.5 - lens[1]) * z / lens[0]
            py = (y + 0.5 - lens[2]) * z / lens[0]
            reach = lens[0] * radius / z
            spin = 6.2831853 * ((52.9829189 * ((0.06711056 * x + 0.00583715 * y) % 1.0)) % 1.0)
            total = 0.0
            for i in range(samples):
                part = (i + 0.5) / samples
                angle = 6.2831853 * part * SPIRAL_TURNS + spin
                sx = int(x + reach * part * np.cos(angle))
                sy = int(y + reach * part * np.sin(angle))
                if sx < 0 or sy < 0 or sx >= width or sy >= height or depth[sy, sx] == np.inf:
                    continue
                sz = np.float64(depth[sy, sx])
                vx = (sx + 0.5 - lens[1]) * sz / lens[0] - px
                vy = (sy + 0.5 - lens[2]) * sz / lens[0] - py
                vz = sz - z
                square = vx * vx + vy * vy + vz * vz
                fall = max(radius * radius - square, 0.0)
                rise = vx * n[0] + vy * n[1] + vz * n[2] - bias
                total += fall * fall * fall * max(rise / (square + 1e-4 * radius * radius), 0.0)
            # 1 / (1 + a) where the source has max(0, 1 - a): deep hollows stay readable
            open_sky[y, x] /= 1.0 + 6.0 * total * radius / (radius**6 * samples)


@kernel
def shadow(
    depth: F32,
    normal: F32,
    turn: F64,
    lens: F64,
    reach: float,
    thickness: float,
    bias: float,
    steps: int,
    lit: F32,
) -> None:
    """Whether the key lamp reaches each pixel, as far as the picture itself can tell.

    depth, normal, turn, lens : as for occlusion
    reach, thickness, bias : world units: length of the ray, how far behind its front a thing still
        blocks, and the start above the surface
    lit : (h, w) float32, 0 (shadow) ... 1, written
    returns: nothing
    errors : none
    source : screen-space ray marching, after Ritschel, Grosch, Seidel (I3D 2009), section 3
    """
    height, width = depth.shape
    for y in range(height):
        for x in range(width):
            z = np.float64(depth[y, x])
            lit[y, x] = 1.0
            if z == np.inf:
                continue
            n = _camera_normal(normal, turn, x, y)
            grain = (52.9829189 * ((0.06711056 * x + 0.00583715 * y) % 1.0)) % 1.0
            other = (52.9829189 * ((0.00583715 * x + 0.06711056 * y + 0.37) % 1.0)) % 1.0
            # a lamp 0.24 rad wide: each pixel asks one point of it, and `smooth` blends them
            wx = KEY_WAY[0] + 0.24 * (grain - 0.5)
            wy, wz = KEY_WAY[1] + 0.24 * (other - 0.5), KEY_WAY[2]
            px = (x + 0.5 - lens[1]) * z / lens[0] + n[0] * bias
            py = (y + 0.5 - lens[2]) * z / lens[0] + n[1] * bias
            pz = z + n[2] * bias
            for i in range(steps):
                along = reach * ((i + 0.25 + 0.75 * grain) / steps) ** 1.5
                qz = pz + wz * along
                if qz <= 0.0:
                    break
                sx = int(np.floor((px + wx * along) / qz * lens[0] + lens[1]))
                sy = int(np.floor((py + wy * along) / qz * lens[0] + lens[2]))
                if sx < 0 or sy < 0 or sx >= width or sy >= height:
                    break
                behind = qz - depth[sy, sx]
                if bias < behind < thickness:
                    lit[y, x] = along / reach * 0.5  # far blockers let more light around them
                    break


@kernel
def _camera_normal(normal: F32, turn: F64, x: int, y: int) -> Vector:
    """Unit normal of a pixel in camera space, turned to face the eye's side; zero = no direction.

    normal : (h, w, 3) float32, grid axes; turn : (3, 3) float64
    returns: 3 float64
    errors : none
    """
    a, b = np.float64(normal[y, x, 0]), np.float64(normal[y, x, 1])
    c = np.float64(normal[y, x, 2])
    nx = turn[0, 0] * a + turn[0, 1] * b + turn[0, 2] * c
    ny = turn[1, 0] * a + turn[1, 1] * b + turn[1, 2] * c
    nz = turn[2, 0] * a + turn[2, 1] * b + turn[2, 2] * c
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    # a mirror, not a flip: continuous where an averaged normal leans past the silhouette
    return nx / length, ny / length, -abs(nz) / length


@kernel
def smooth(values: F32, depth: F32, reach: int, tolerance: float, out: F32) -> None:
    """Box mean over the neighbours at about the same depth: takes the grain out of `occlusion`.

    values, depth, out : (h, w) float32; reach : pixels; tolerance : world units
    returns: nothing
    errors : none
    source : cross bilateral filter, Petschnigg et al. (2004), with a box for both weights
    """
    height, width = depth.shape
    for y in range(height):
        for x in range(width):
            z = depth[y, x]
            if z == np.inf:
                out[y, x] = values[y, x]
                continue
            total, count = 0.0, 0
            for v in range(max(y - reach, 0), min(y + reach + 1, height)):
                for u in range(max(x - reach, 0), min(x + reach + 1, width)):
                    if abs(depth[v, u] - z) <= tolerance:
                        total += values[v, u]
                        count += 1
            out[y, x] = total / count


@kernel
def light(
    depth: F32,
    normal: F32,
    colour: U8,
    turn: F64,
    upward: F64,
    albedo: F64,
    open_sky: F32,
    lit: F32,
    scale: int,
    out: F32,
) -> None:
    """Light every drawn pixel; the background stays as it is in `out`.

    depth, normal, turn : as for occlusion; colour : (h, w, 3) uint8 sRGB
    upward : (3,) float64, camera space; albedo : (256,) float64, sRGB code -> linear
    open_sky, lit : (h / scale, w / scale) float32; out : (h, w, 3) float32 linear light
    returns: nothing
    errors : none
    source : wrapped diffuse and hemisphere ambient; Blinn (1977) for the gloss
    """
    for y in range(depth.shape[0]):
        for x in range(depth.shape[1]):
            if depth[y, x] == np.inf:
                continue
            n = _camera_normal(normal, turn, x, y)
            flat = n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0
            if flat:
                n = (0.0, 0.0, -1.0)
            sky = 0.5 + 0.5 * (n[0] * upward[0] + n[1] * upward[1] + n[2] * upward[2])
            key, fill = _towards(n, KEY_WAY, 0.12), _towards(n, FILL_WAY, 0.35)
            rim = _towards(n, RIM_WAY, 0.0)
            shade = np.float64(open_sky[y // scale, x // scale])
            sun = np.float64(lit[y // scale, x // scale])
            gloss = 0.0 if flat else _towards(n, HALF_WAY, 0.0) ** 40 * GLOSS
            for c in range(3):
                ambient = (GROUND[c] + (SKY[c] - GROUND[c]) * sky) * shade
                lamps = KEY[c] * key * sun * (0.5 + 0.5 * shade) + FILL[c] * fill * shade
                diffuse = albedo[colour[y, x, c]] * (ambient + lamps)
                out[y, x, c] = diffuse + (gloss * sun * KEY[c] + 0.25 * RIM[c] * rim) * shade


@kernel
def _towards(n: Vector, way: Vector, wrap: float) -> float:
    """Lambert's cosine, wrapped around the edge by `wrap`, 0 ... 1.

    n, way : 3 floats; wrap : float
    returns: float64
    errors : none
    source : Green, Real-Time Approximations to Subsurface Scattering, GPU Gems (2004)
    """
    cosine = n[0] * way[0] + n[1] * way[1] + n[2] * way[2]
    return max(0.0, (cosine + wrap) / (1.0 + wrap))
