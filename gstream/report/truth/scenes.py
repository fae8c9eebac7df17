"""The built-in scenes, by name: meshes of surfaces that are known exactly. Nothing of a kernel's.

A mesh of flat triangles is not the curved surface: `floor` says how far it is from it at most, so
that no error below that is blamed on the voxels. The closed ones are closed to the bit.
"""

from collections.abc import Callable
from math import ceil, pi, sqrt

import numpy as np

from gstream.report.truth.mesh import scene_of_mesh
from gstream.report.truth.scene import (
    SAMPLES,
    Bools,
    Codes,
    Floats,
    Ints,
    Scene,
    codes_of_linear,
    linear_of_codes,
    spread,
    spread_on,
    write_ply,
)
from gstream.report.truth.shapes import (
    BOX_CORNERS,
    BOX_TRIANGLES,
    ball,
    directions,
    frames,
    from_box,
    from_circle,
    on_ring,
    ring,
)

__all__ = ["SCENES", "Floats", "Ints", "Scene", "write_ply"]

PLANES = 4  # rectangles along each axis
SHADE = 0.1  # linear light from a rectangle's middle to its edge; less than a code in half a voxel
RING, TUBE = 1.0, 0.4  # radii of the torus
FILAMENTS = 6
WAVES = 60  # of the noise, 2 to 56 radians along the sphere's radius
THREAD = 0.0015  # radius of a filament; voxels at 256 per axis are 0.0076

# The room, low and high corners in 1/1024 of the grid: faces at multiples of 32 lie between voxels
# at 32 voxels per axis and more; those at odd multiples of 1, 2, 4 and 8 go through the centres of
# voxels at 512, 256, 128 and 64 per axis, and between voxels at more.
HOUSE = ((32, 64, 256), (992, 960, 768))
HALL = ((64, 96, 288), (960, 928, 736))
FURNITURE = (
    ((324, 130, 320), (356, 601, 704)),  # two walls
    ((392, 648, 330), (872, 680, 700)),
    ((448, 736, 328), (512, 800, 644)),  # a pillar
    ((640, 160, 449), (896, 352, 466)),  # a slab
)
LAMPS = (  # outside, at the scene's ends: those lie on no plane of a grid, the house's faces do
    ((0, 480, 480), (16, 544, 544)),
    ((1008, 480, 480), (1024, 544, 544)),
)


def planes(resolution: int) -> Scene:
    """64 rectangles, each at an angle of its own, their colour linear in linear light."""
    pitch = 1 / PLANES
    sites = (np.indices((PLANES,) * 3).reshape(3, -1).T + 0.5) * pitch
    first, second, normal = frames(len(sites))
    half = pitch / 4  # the corners stay 0.29 pitch away from the neighbours' at any angle
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    spanned = signs[:, :1] * first[:, None] + signs[:, 1:] * second[:, None]
    points = (sites[:, None] + half * spanned).reshape(-1, 3)
    quads = 4 * np.arange(len(sites))[:, None, None] + np.array([(0, 1, 2), (0, 2, 3)])
    colours = _rectangle_colours(len(sites), signs)

    def locate(at: Floats) -> tuple[Floats, Ints, Floats]:
        """Distance, rectangle, and the place on it that is nearest, (k, 2) from -1 to 1."""
        best, owner = np.full(len(at), np.inf), np.zeros(len(at), np.int64)
        places = np.zeros((len(at), 2))
        for i, site in enumerate(sites):
            local = (at - site) @ np.stack([first[i], second[i], normal[i]], axis=1)
            place = np.clip(local[:, :2], -half, half)
            local[:, :2] -= place
            distance = np.linalg.norm(local, axis=1)
            closer = distance < best
            owner[closer], places[closer] = i, place[closer] / half
            best = np.minimum(best, distance)
        return best, owner, places

    def nearest(at: Floats) -> tuple[Floats, Floats]:
        distance, owner, _ = locate(at)
        return distance, normal[owner]

    def colour(at: Floats) -> Floats:
        _, owner, places = locate(at)
        s, t = (places.T[:, :, None] + 1) / 2
        a, b, c, d = linear_of_codes(colours).reshape(-1, 4, 3)[owner].transpose(1, 0, 2)
        light: Floats = np.where(
            s >= t, a + s * (b - a) + t * (c - b), a + t * (d - a) + s * (c - d)
        )
        return light

    each = 2 * spread(SAMPLES // len(sites)) - 1
    across = each[:, :1] * first[:, None] + each[:, 1:] * second[:, None]
    return Scene(
        "planes",
        points,
        quads.reshape(-1, 3),
        nearest,
        samples=(sites[:, None] + half * across).reshape(-1, 3),
        area=len(sites) * 4 * half**2,
        colour=colour,
        vertex_colours=colours,
        flat=True,
    )


def sphere(resolution: int) -> Scene:
    """The unit sphere: a cube's six faces, blown up; error below a hundredth of a voxel."""
    points, triangles = ball(resolution)

    def nearest(at: Floats) -> tuple[Floats, Floats]:
        radius = np.linalg.norm(at, axis=1)
        return np.abs(radius - 1), at / radius[:, None]

    return Scene(
        "sphere",
        points,
        triangles,
        nearest,
        samples=directions(SAMPLES),
        area=4 * pi,
        closed=True,
        inside=lambda at: np.linalg.norm(at, axis=1) < 1,
    )


def torus(resolution: int) -> Scene:
    """A ring of radius 1 and a tube of radius 0.4 about z."""
    points, triangles = ring(ceil(16 * sqrt(resolution)), ceil(8.4 * sqrt(resolution)), RING, TUBE)

    def nearest(at: Floats) -> tuple[Floats, Floats]:
        distance, outward = from_circle(at, RING)
        return np.abs(distance - TUBE), outward

    return Scene(
        "torus",
        points,
        triangles,
        nearest,
        # dense on the inner side, thin on the outer one: for the largest distance that is no matter
        samples=on_ring(spread(SAMPLES), RING, TUBE),
        area=4 * pi**2 * RING * TUBE,
        closed=True,
        inside=lambda at: from_circle(at, RING)[0] < TUBE,
    )


def room(resolution: int) -> Scene:
    """A house with a hall in it, and in that walls, a pillar and a slab: boxes full of ties.

    The grid is 1025/1024 wide about the middle and so begins at -1/2048: where the voxels per axis
    are a power of two, all of it is exact in binary.
    """
    boxes = np.array([HOUSE, HALL, *FURNITURE, *LAMPS]) * (1025 / 2**20) - 2.0**-11
    boxes = np.clip(boxes, 0, 1)  # the lamps' ends
    solid = np.array([1, -1, 1, 1, 1, 1, 1, 1])
    corners = np.where(BOX_CORNERS, boxes[:, 1:], boxes[:, :1])
    triangles = np.concatenate([8 * i + BOX_TRIANGLES[:, ::way] for i, way in enumerate(solid)])
    points = corners.reshape(-1, 3)

    def nearest(at: Floats) -> tuple[Floats, Floats]:
        best, normal = np.full(len(at), np.inf), np.zeros((len(at), 3))
        for (low, high), way in zip(boxes, solid, strict=True):
            distance, outward = from_box(at, low, high)
            closer = distance < best
            best[closer], normal[closer] = distance[closer], way * outward[closer]
        return best, normal

    def inside(at: Floats) -> Bools:
        within = (at > boxes[:, 0, None]) & (at <= boxes[:, 1, None])
        odd: Bools = within.all(axis=2).sum(axis=0) % 2 == 1
        return odd

    sides = boxes[:, 1] - boxes[:, 0]
    return Scene(
        "room",
        points,
        triangles,
        nearest,
        samples=spread_on(points[triangles], SAMPLES),
        area=float(2 * (sides * np.roll(sides, 1, axis=1)).sum()),
        closed=True,
        inside=inside,
        flat=True,
    )


def filaments(resolution: int) -> Scene:
    """Rings of thread, each at an angle of its own, a fifth of a voxel thick at 256 per axis."""
    turned = np.stack(frames(FILAMENTS), axis=2)  # local -> world
    middles = 0.1 * directions(FILAMENTS)
    radii = 1 - 0.4 * np.arange(FILAMENTS) / FILAMENTS
    around = ceil(16 * sqrt(resolution))
    rings = [ring(around, 36, radius, THREAD) for radius in radii]
    points = np.stack([points for points, _ in rings]) @ turned.transpose(0, 2, 1)
    starts = points.shape[1] * np.arange(FILAMENTS)[:, None, None]
    turns = spread(SAMPLES // FILAMENTS)
    samples = np.stack([on_ring(turns, radius, THREAD) for radius in radii])

    def locate(at: Floats) -> tuple[Floats, Floats]:
        """Distance from the nearest thread's middle, and the way from there."""
        best, way = np.full(len(at), np.inf), np.zeros((len(at), 3))
        for frame, middle, radius in zip(turned, middles, radii, strict=True):
            distance, outward = from_circle((at - middle) @ frame, radius)
            closer = distance < best
            best[closer], way[closer] = distance[closer], (outward @ frame.T)[closer]
        return best, way

    def nearest(at: Floats) -> tuple[Floats, Floats]:
        distance, outward = locate(at)
        return np.abs(distance - THREAD), outward

    return Scene(
        "filaments",
        (points + middles[:, None]).reshape(-1, 3),
        (starts + np.stack([triangles for _, triangles in rings])).reshape(-1, 3),
        nearest,
        samples=(samples @ turned.transpose(0, 2, 1) + middles[:, None]).reshape(-1, 3),
        area=float(4 * pi**2 * THREAD * radii.sum()),
        closed=True,
        inside=lambda at: locate(at)[0] < THREAD,
    )


def noise(resolution: int) -> Scene:
    """A sphere as a scanner sees it: waves of many lengths on it. The mesh is the surface."""
    points, triangles = ball(resolution)
    pace = 2 * 28 ** (np.arange(WAVES) / (WAVES - 1))
    height = 0.02 * pace**-0.5
    phases = points @ (directions(WAVES) * pace[:, None]).T + 2 * pi * spread(WAVES)[:, 0]
    radius = 1 + np.sin(phases) @ height
    return scene_of_mesh("noise", points * radius[:, None], triangles)


SCENES: dict[str, Callable[[int], Scene]] = {
    "planes": planes,
    "sphere": sphere,
    "torus": torus,
    "room": room,
    "noise": noise,
    "filaments": filaments,
}


def _rectangle_colours(count: int, signs: Ints) -> Codes:
    """(4 * count, 3) sRGB codes of corners: a colour of its own, and a slope for each channel."""
    base = 0.3 + 0.5 * np.concatenate([spread(count), spread(2 * count)[count:, :1]], axis=1)
    slopes = SHADE * np.array([(1, 0, 0.5), (0, 1, 0.5)])
    light = base[:, None] + signs @ slopes
    return np.rint(codes_of_linear(light)).astype(np.uint8).reshape(-1, 3)
