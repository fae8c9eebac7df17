"""Where the camera is, and what it makes of boxes: matrices, frustum test, projected voxel size.

Everything here is in grid coordinates: finest voxels, as `spec/blockfile.md` 8.1 counts them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, degrees, radians, tan

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Depth buffers have 24 bits: at the far end they resolve 2^-24 of this ratio times the distance.
FAR_OVER_NEAR = 20_000.0
FIT_MARGIN = 1.08
DEFAULT_FOV = 30.0


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole or a parallel projection in world coordinates.

    height : of what a parallel projection shows, in world units; 0 = perspective with `fov`
    fov : vertical, in degrees
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov: float = DEFAULT_FOV
    height: float = 0.0

    def axes(self) -> Floats:
        """(3, 3) rows: to the right, up, backwards; orthonormal whatever `up` is."""
        back = _unit(np.subtract(self.position, self.target))
        if not back.any():
            back = np.array([0.0, 0.0, 1.0])
        right = np.cross(_unit(np.array(self.up)), back)
        if np.linalg.norm(right) <= 1e-6:  # or rounding tells
            right = np.cross(np.eye(3)[int(np.argmin(np.abs(back)))], back)
        right = _unit(right)
        return np.stack((right, np.cross(back, right), back))

    def orbit(self, azimuth: float, elevation: float) -> Camera:
        """Turned about the target by degrees: to the right, and upwards but not over the pole."""
        offset = np.subtract(self.position, self.target)
        up = _unit(np.array(self.up))
        aside = float(np.linalg.norm(np.cross(offset, up)))
        lift = degrees(atan2(float(offset @ up), aside))
        rise = min(max(lift + elevation, -89.0), 89.0) - lift
        offset = _turn(up, azimuth) @ _turn(-self.axes()[0], rise) @ offset
        return replace(self, position=_point(np.add(self.target, offset)))

    def zoom(self, factor: float) -> Camera:
        """Nearer to the target (factor above 1), or a smaller part of a parallel projection."""
        offset = np.subtract(self.position, self.target) / factor
        position = _point(np.add(self.target, offset))
        return replace(self, position=position, height=self.height / factor)

    def move(self, right: float, up: float, forward: float) -> Camera:
        """Moved with its target, in world units along its own axes."""
        step = np.array([right, up, -forward]) @ self.axes()
        target = _point(np.add(self.target, step))
        return replace(self, position=_point(np.add(self.position, step)), target=target)


def fit(
    box: Floats, direction: Floats, up: Floats, aspect: float, fov: float = DEFAULT_FOV
) -> Camera:
    """A camera that sees a whole world box (2, 3); `direction` points from it to the camera."""
    centre = box.mean(axis=0)
    camera = Camera(_point(centre + direction), _point(centre), _point(up), fov)
    right, above, back = camera.axes()
    corners = box[[[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], [0, 1, 2]] - centre
    slope = tan(radians(fov) / 2)
    needed = np.maximum(np.abs(corners @ right) / aspect, np.abs(corners @ above)) / slope
    # A corner on the axis needs no distance to be in the picture, but one to be before the eye.
    needed = np.maximum(needed, 1e-3 * np.linalg.norm(box[1] - box[0]))
    distance = float((FIT_MARGIN * needed + corners @ back).max())
    return replace(camera, position=_point(centre + back * (distance or 1.0)))


@dataclass(frozen=True, slots=True)
class View:
    """A camera over a viewport, for one grid: what traversal and drawing need of it."""

    clip: Floats  # (4, 4): grid coordinates to clip coordinates
    eye: (
        Floats  # (3,) or, of a parallel projection, the direction towards the eye: grid coordinates
    )
    perspective: bool
    pixels: float  # height in pixels of one grid unit at w = 1
    slopes: tuple[float, float]  # of the viewport's right and upper border against the axis

    @staticmethod
    def of(camera: Camera, size: tuple[int, int], matrix: Floats, box: Floats) -> View:
        """The view of a grid.

        size : width and height in pixels, at least 1
        matrix : (3, 4), grid to world
        box : (2, 3), what is to lie between the near and the far plane, in grid coordinates
        """
        width, height = max(size[0], 1), max(size[1], 1)
        aspect = width / height
        axes = camera.axes()
        world = np.vstack((matrix, (0.0, 0.0, 0.0, 1.0)))
        sight = np.eye(4)
        sight[:3, :3] = axes
        sight[:3, 3] = -axes @ np.array(camera.position)
        grid = sight @ world
        depth = np.array([0.0, 0.0, -1.0, 0.0]) @ grid
        centre, half = box.mean(axis=0), (box[1] - box[0]) / 2
        middle, reach = depth[:3] @ centre + depth[3], np.abs(depth[:3]) @ half
        far = max(middle + reach, 1e-6) * 1.001
        perspective = camera.height <= 0
        if perspective:
            near = max((middle - reach) * 0.999, far / FAR_OVER_NEAR)
            slope = tan(radians(min(max(camera.fov, 0.01), 170.0)) / 2)
            projection = np.zeros((4, 4))
            projection[0, 0], projection[1, 1] = 1 / (slope * aspect), 1 / slope
            projection[2, 2:] = (far + near) / (near - far), 2 * far * near / (near - far)
            projection[3, 2] = -1.0
        else:
            near = middle - reach - 1e-3 * max(reach, 1e-6)
            far = max(far, near + 1e-6)
            slope = 0.0
            projection = np.eye(4)
            projection[0, 0] = 2 / (camera.height * aspect)
            projection[1, 1] = 2 / camera.height
            projection[2, 2:] = 2 / (near - far), (far + near) / (near - far)
        inverse = np.linalg.inv(world)
        eye = inverse[:3] @ (*camera.position, 1.0) if perspective else inverse[:3, :3] @ axes[2]
        edge = float(np.linalg.norm(matrix[:, :3], 2))
        pixels = edge * float(projection[1, 1]) * height / 2
        return View(projection @ grid, eye, perspective, pixels, (slope * aspect, slope))

    def seen(self, low: Floats, high: Floats) -> NDArray[np.bool_]:
        """(n,) which of the boxes (n, 3) may be in the viewport: none that is, is missed."""
        rows = self.clip
        planes = np.stack([rows[3] + sign * rows[axis] for axis in range(3) for sign in (1, -1)])
        centre, half = (low + high) / 2, (high - low) / 2
        furthest = centre @ planes[:, :3].T + half @ np.abs(planes[:, :3]).T + planes[:, 3]
        # Rounding: the sum's terms are that large, and a box that touches a plane is seen.
        slack = 1e-12 * (np.abs(centre) @ np.abs(planes[:, :3]).T + np.abs(planes[:, 3]))
        inside: NDArray[np.bool_] = (furthest >= -slack).all(axis=1)
        return inside

    def voxel_pixels(self, low: Floats, high: Floats, edge: Floats) -> Floats:
        """(n,) an upper bound of a voxel's edge in pixels, wherever in its box it is drawn.

        low, high : (n, 3) boxes; edge : (n,) voxel edges, in finest voxels

        A segment of length e at depth z, seen at slope s from the axis, is at most e·√(1 + s²)/z
        long on the screen; a box that reaches the eye's plane has no bound.
        """
        if not self.perspective:
            return edge * self.pixels
        centre, half = (low + high) / 2, (high - low) / 2
        depth = centre @ self.clip[3, :3] + self.clip[3, 3] - half @ np.abs(self.clip[3, :3])
        bound = np.full(len(edge), np.inf)
        near = depth > 0
        aside = np.abs(centre @ self.clip[:2, :3].T + self.clip[:2, 3])
        aside += half @ np.abs(self.clip[:2, :3]).T
        # What is beyond the border of the viewport, at 1, is not drawn.
        share = np.minimum(aside, np.maximum(depth, 0)[:, None])
        slopes = np.divide(share, depth[:, None], out=np.ones_like(share), where=near[:, None])
        stretch = np.sqrt(1 + (slopes**2) @ (np.array(self.slopes) ** 2))
        np.divide(edge * self.pixels * stretch, depth, out=bound, where=near)
        return bound

    def distance(self, low: Floats, high: Floats) -> Floats:
        """(n,) how far boxes are from the eye at least: the order in which they are drawn."""
        if not self.perspective:
            centre, half = (low + high) / 2, (high - low) / 2
            return -(centre @ self.eye) - half @ np.abs(self.eye)
        outside = np.maximum(np.maximum(low - self.eye, self.eye - high), 0)
        return np.asarray(np.linalg.norm(outside, axis=1))

    def local(self, origin: NDArray[np.int64]) -> NDArray[np.float32]:
        """The clip matrix for coordinates relative to `origin`, transposed as GL reads it."""
        shift = np.eye(4)
        shift[:3, 3] = origin
        return np.ascontiguousarray((self.clip @ shift).T, dtype=np.float32)


def _unit(vector: Floats) -> Floats:
    """The vector with length 1, however short it is; 0 stays 0."""
    longest = float(np.abs(vector).max())
    if longest == 0:
        return vector
    scaled = vector / longest  # the square of what is below 1e-160 is nothing
    return np.asarray(scaled / np.linalg.norm(scaled))


def _turn(axis: Floats, angle: float) -> Floats:
    """The matrix that turns by degrees about a unit vector."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(radians(angle)), np.cos(radians(angle))
    matrix: Floats = np.eye(3) + s * cross + (1 - c) * (cross @ cross)
    return matrix


def _point(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
