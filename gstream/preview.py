"""A picture of a block file: camera, choice of level and blocks. The drawing is in kernels.

Reads the directory of one level and the columns that a picture shows, of the blocks that it shows.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.blockview import BlockView
from gstream.compiled import compiled
from gstream.errors import UsageError
from gstream.formats.directory import STATE_DATA
from gstream.formats.lodrule import unit_vectors
from gstream.formats.morton import decode_morton
from gstream.formats.png import png
from gstream.kernels import shade, splat
from gstream.read import BlockFile, open_block_file
from gstream.run.publish import publish

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Samples = NDArray[np.float32]
Entries = NDArray[Any]  # structured, formats/directory.py

VIEWS: Final = {  # azimuth, elevation in degrees
    "three-quarter": (35.0, 18.0),
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "back": (180.0, 0.0),
    "left": (270.0, 0.0),
    "top": (0.0, 90.0),
    "bottom": (0.0, -90.0),
}
UP: Final = {  # columns: to the right of, behind, above the object seen from the front
    "z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "y": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
}
MAX_SIDE: Final = 16_384
MAX_PIXELS: Final = 1 << 25  # 8K; at 47 bytes of buffers each, 1.6 GB
MAX_SAMPLES: Final = (
    1 << 24
)  # beyond this many pixels, one sample per pixel: 17 bytes of buffers each
SUPERSAMPLING: Final = 2
OUTLINE_BLOCKS: Final = (
    4096  # the camera is fitted to the finest level that has no more blocks than this
)
FIELD_OF_VIEW: Final = 24.0  # degrees, vertical
MARGIN: Final = 1.10
OCCLUSION_RADII: Final = (0.02, 0.12)  # of the object's extent: creases, and hollows
OCCLUSION_SAMPLES: Final = 24
SHADOW_REACH: Final = 0.5  # of the extent
SHADOW_THICKNESS: Final = 0.25
SHADOW_STEPS: Final = 40
OCCLUSION_BIAS: Final = (
    1.5  # voxel edges: a flat oblique surface is a staircase, and must not shade itself
)
SHADOW_BIAS: Final = 2.5
SMOOTH_REACH: Final = 3  # pixels
CLAY: Final = (208, 196, 182)  # sRGB
SKY_TOP: Final = (236, 239, 243)
SKY_BOTTOM: Final = (178, 186, 197)


@dataclass(frozen=True, slots=True)
class PreviewInfo:
    """What a picture shows and what it cost to read."""

    output: str
    width: int
    height: int
    level: int  # 0 = finest
    blocks: int  # in the level
    blocks_read: int
    voxels: int  # of the blocks that were read


@dataclass(frozen=True, slots=True)
class Camera:
    """A mild perspective, as kernels/splat.py and kernels/shade.py want it."""

    numbers: Floats  # (26,), see kernels/splat.py
    turn: Floats  # (3, 3), normals in grid axes -> camera space, not of unit length
    lens: Floats  # (3,): focal length and the looked-at pixel
    upward: Floats  # (3,), camera space
    distance: float  # eye to the middle of the object, world units
    extent: float  # largest side of the object, world units

    def pixels(self, length: float) -> float:
        """Pixels that a length in the world covers at the middle of the object."""
        return float(self.lens[0]) * length / self.distance


def render(
    path: str | Path,
    output: str | Path,
    size: tuple[int, int] = (1280, 720),
    view: str = "three-quarter",
    level: int | None = None,
    up: str | None = None,
) -> PreviewInfo:
    """Draw the block file `path` into the PNG `output`.

    size : width, height in pixels; view : a name of VIEWS, or "azimuth,elevation" in degrees;
    level : None picks the one whose voxel is about a pixel; up : y or z, None = as the file says
    errors : UsageError, and those of reading
    """
    width, height = size
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS):
        raise UsageError(
            f"--size {width}x{height} is out of range",
            f"give at most {MAX_SIDE} a side and {MAX_PIXELS >> 20} Mi pixels",
        )
    direction = parse_view(view)
    scale = SUPERSAMPLING if width * height * SUPERSAMPLING**2 <= MAX_SAMPLES else 1
    with open_block_file(path, choose=compiled) as file:
        scene = Scene.of_file(file, up)
        if level is not None and not 0 <= level < file.levels:
            raise UsageError(f"{path}: there is no level {level}", f"give 0 to {file.levels - 1}")
        samples = (width * scale, height * scale)
        camera = fit_camera(*scene.outline(), file.matrix, UP[scene.up], direction, samples)
        chosen = scene.level_for(camera, scale) if level is None else level
        picture = Picture.blank(*samples)
        blocks, read, voxels = picture.draw(scene, camera, chosen)
    rgb = picture.developed(camera, scene.voxel_size * 2**chosen, scale)
    with publish(output) as sink:
        sink.write(png(rgb))
    return PreviewInfo(str(output), width, height, chosen, blocks, read, voxels)


def parse_view(view: str) -> tuple[float, float]:
    """Azimuth and elevation in degrees of a view's name or of "azimuth,elevation"."""
    if view in VIEWS:
        return VIEWS[view]
    parts = view.split(",")
    try:
        azimuth, elevation = float(parts[0]), float(parts[1])
    except (ValueError, IndexError):
        azimuth = elevation = float("nan")
    if len(parts) != 2 or not (abs(azimuth) <= 3600 and abs(elevation) <= 90):
        remedy = (
            f"give one of {', '.join(VIEWS)}, or AZIMUTH,ELEVATION in degrees (elevation -90 to 90)"
        )
        raise UsageError(f"--view {view} is not understood", remedy)
    return azimuth, elevation


@dataclass(frozen=True, slots=True)
class Scene:
    """An open block file as the picture sees it: everything in index space of level 0."""

    file: BlockFile
    up: str  # a key of UP
    entries: dict[int, Entries]  # directory rows of the levels asked for so far

    @classmethod
    def of_file(cls, file: BlockFile, up: str | None) -> "Scene":
        """A file whose up axis is neither y nor z, or not said, is shown with z up."""
        if up is not None and up not in UP:
            raise UsageError(f"up axis {up!r} is not known", f"give one of {', '.join(UP)}")
        said = str(file.metadata.get("up", "z")).lower().lstrip("+")
        return cls(file, up or (said if said in UP else "z"), {})

    @property
    def voxel_size(self) -> float:
        """Edge of a finest voxel, world units."""
        return float(abs(np.linalg.det(self.file.matrix[:, :3])) ** (1 / 3))

    def bounds(self, level: int) -> tuple[Floats, Floats]:
        """Tight boxes of a level's blocks, directory order: low and high corners, (blocks, 3)."""
        if level not in self.entries:
            directory = self.file.directory
            rows = np.concatenate([directory.page(page) for page in directory.pages_of(level)])
            self.entries[level] = rows[(rows["level"] == level) & (rows["state"] == STATE_DATA)]
        rows = self.entries[level]
        corner = decode_morton(rows["key"]).astype(np.float64) * self.file.block_edge
        return (corner + rows["low"]) * 2.0**level, (corner + rows["high"] + 1) * 2.0**level

    def outline(self) -> tuple[Floats, Floats]:
        """Boxes around everything: those of the finest level that has few enough blocks."""
        blocks = self.file.head.levels["blocks"]
        fitting = [level for level in range(self.file.levels) if blocks[level] <= OUTLINE_BLOCKS]
        return self.bounds(fitting[0] if fitting else self.file.levels - 1)

    def level_for(self, camera: Camera, scale: int) -> int:
        """The coarsest level whose voxel covers at most one pixel of the finished picture."""
        finest = camera.pixels(self.voxel_size) / scale
        return min(max(0, int(np.floor(-np.log2(finest)))), self.file.levels - 1)

    def voxels(self, level: int, row: int) -> tuple[NDArray[np.int64], Samples, Bytes]:
        """One block: low corners, normals in grid axes, sRGB codes or (0, 3); each (n, 3)."""
        block = BlockView(self.file, self.entries[level][row])
        positions = block.positions().astype(np.int64) << level
        if "normal" in self.file.columns:
            normals = block.normals()
        elif "mask" in self.file.columns:
            normals = MASK_NORMALS[block.mask]
        else:
            normals = np.zeros((len(positions), 3), np.float32)
        colours = (
            block.colour[:, :3] if "colour" in self.file.columns else np.empty((0, 3), np.uint8)
        )
        return positions, normals, np.ascontiguousarray(colours)


def _mask_normals() -> Samples:
    """(64, 3): the mean direction of each mask's faces, of length 1, or 0 where they cancel."""
    bits = np.arange(64)[:, None] >> np.arange(6) & 1
    sums = (bits[:, 1::2] - bits[:, ::2]).astype(np.float32)
    return unit_vectors(sums)


MASK_NORMALS: Final = _mask_normals()


def fit_camera(
    low: Floats,
    high: Floats,
    matrix: Floats,
    up: tuple[tuple[float, float, float], ...],
    direction: tuple[float, float],
    size: tuple[int, int],
) -> Camera:
    """The camera that looks from `direction` and shows all boxes as large as fits.

    low, high : (n, 3) index space; matrix : (3, 4) index -> world; up : a value of UP
    direction : azimuth, elevation, degrees; size : pixels
    """
    turn = _turn(np.array(up), *np.radians(direction))
    spread, shift = matrix[:, :3], matrix[:, 3]
    choice = np.array(list(np.ndindex(2, 2, 2)), bool)
    corners = np.where(choice[:, None, :], high, low).reshape(-1, 3) @ spread.T + shift
    seen = corners @ turn.T
    focal = size[1] / 2 / np.tan(np.radians(FIELD_OF_VIEW / 2))
    slope = np.array(size) / 2 / focal / MARGIN
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    distance = 0.0
    for _ in range(
        12
    ):  # moving sideways changes what limits the distance; this settles within a few rounds
        away = seen - middle
        distance = float((np.abs(away[:, :2]) / slope - away[:, 2:]).max())
        flat = away[:, :2] / (away[:, 2:] + distance)
        middle[:2] += (flat.min(axis=0) + flat.max(axis=0)) / 2 * distance
    eye = middle @ turn - turn[2] * distance
    lens = np.array([focal, size[0] / 2, size[1] / 2])
    to_camera = np.column_stack([turn @ spread, turn @ (shift - eye)]) * [[focal], [focal], [1]]
    to_ray = np.array([[1, 0, -lens[1]], [0, 1, -lens[2]], [0, 0, focal]]) / focal
    back = np.linalg.inv(spread)
    numbers = np.concatenate(
        [to_camera.ravel(), back @ (eye - shift), (back @ turn.T @ to_ray).ravel(), lens[1:]]
    )
    extent = float((seen.max(axis=0) - seen.min(axis=0)).max())
    return Camera(numbers, turn @ back.T, lens, turn @ np.array(up[2]), distance, extent)


def _turn(up: Floats, azimuth: float, elevation: float) -> Floats:
    """World -> camera directions, rows right, down, away; radians."""
    right, behind, above = up
    eye = (
        np.cos(elevation) * (np.sin(azimuth) * right - np.cos(azimuth) * behind)
        + np.sin(elevation) * above
    )
    sideways = np.cos(azimuth) * right + np.sin(azimuth) * behind
    return np.stack([sideways, np.cross(-eye, sideways), -eye])


@dataclass(slots=True)
class Picture:
    """What each sample sees; drawn into in place."""

    depth: NDArray[np.float32]  # (h, w), camera z, inf = background
    normal: NDArray[np.float32]  # (h, w, 3), world
    colour: Bytes  # (h, w, 3), sRGB

    @classmethod
    def blank(cls, width: int, height: int) -> "Picture":
        colour = np.empty((height, width, 3), np.uint8)
        colour[:] = CLAY
        normal = np.zeros((height, width, 3), np.float32)
        return cls(np.full((height, width), np.inf, np.float32), normal, colour)

    def draw(self, scene: "Scene", camera: Camera, level: int) -> tuple[int, int, int]:
        """Draw a level, nearest blocks first, hidden ones never read; blocks, read, voxels."""
        low, high = scene.bounds(level)
        away = (low + high) / 2 @ camera.numbers[8:11]
        read = voxels = 0
        for row in np.argsort(away, kind="stable"):
            if splat.is_hidden(self.depth, camera.numbers, low[row], high[row]):
                continue
            positions, normals, colours = scene.voxels(level, int(row))
            splat.splat(
                *(camera.numbers, positions, 1 << level, normals, colours),
                *(self.depth, self.normal, self.colour),
            )
            read += 1
            voxels += len(positions)
        return len(low), read, voxels

    def developed(self, camera: Camera, edge: float, scale: int) -> Bytes:
        """Light it, average scale x scale samples, and encode: (h, w, 3) sRGB codes.

        edge : of a voxel of the drawn level, world units
        """
        height, width = self.depth.shape
        linear = _background(width, height)
        open_sky, lit = self._pooled(scale)._blocked(camera, edge, scale)
        shade.light(
            *(self.depth, self.normal, self.colour, camera.turn, camera.upward),
            *(SRGB_TO_LINEAR, open_sky, lit, scale, linear),
        )
        pooled = linear.reshape(height // scale, scale, width // scale, scale, 3).mean(axis=(1, 3))
        return encode_srgb(pooled)

    def _pooled(self, scale: int) -> "Picture":
        """The nearest of each scale x scale samples."""
        height, width = self.depth.shape
        shape = (height // scale, scale, width // scale, scale)
        depth = self.depth.reshape(shape).swapaxes(1, 2).reshape(*shape[::2], -1)
        normal = self.normal.reshape(*shape, 3).swapaxes(1, 2).reshape(*shape[::2], -1, 3)
        nearest = depth.argmin(axis=2)[..., None]
        return Picture(
            np.take_along_axis(depth, nearest, 2)[..., 0],
            np.take_along_axis(normal, nearest[..., None], 2)[:, :, 0],
            self.colour[::scale, ::scale],
        )

    def _blocked(self, camera: Camera, edge: float, scale: int) -> tuple[Samples, Samples]:
        """How much of the sky, and of the key lamp, each pixel sees: two (h, w) float32, 0 to 1."""
        open_sky, lit = np.ones_like(self.depth), np.empty_like(self.depth)
        seen = (self.depth, self.normal, camera.turn, camera.lens / scale)
        for part in OCCLUSION_RADII:
            radius = max(camera.extent * part, 4 * edge)
            shade.occlusion(*seen, radius, OCCLUSION_BIAS * edge, OCCLUSION_SAMPLES, open_sky)
        reach, thickness = camera.extent * SHADOW_REACH, camera.extent * SHADOW_THICKNESS
        shade.shadow(*seen, reach, thickness, SHADOW_BIAS * edge, SHADOW_STEPS, lit)
        tolerance = max(2 * edge, camera.extent * 0.01)
        return self._smoothed(open_sky, tolerance), self._smoothed(lit, tolerance)

    def _smoothed(self, values: Samples, tolerance: float) -> Samples:
        out = np.empty_like(values)
        shade.smooth(values, self.depth, SMOOTH_REACH, tolerance, out)
        return out


def _background(width: int, height: int) -> NDArray[np.float32]:
    """A vertical gradient that darkens a little towards the corners, (h, w, 3) linear light."""
    y = np.linspace(0, 1, height)[:, None, None]
    top, bottom = (SRGB_TO_LINEAR[np.array(code)] for code in (SKY_TOP, SKY_BOTTOM))
    across = np.linspace(-1, 1, width)[None, :, None]
    corner = 1 - 0.10 * (across**2 + (2 * y - 1) ** 2) / 2
    return np.asarray((top * (1 - y) + bottom * y) * corner, np.float32)


def encode_srgb(linear: NDArray[np.float32]) -> Bytes:
    """Linear light to sRGB codes; what is brighter than white rolls off instead of clipping."""
    knee = 0.8
    over = np.maximum(linear - knee, 0)
    rolled = np.where(
        linear > knee, knee + (1 - knee) * over / (over + (1 - knee)), np.maximum(linear, 0)
    )
    curved = np.where(
        rolled <= 0.0031308, rolled * 12.92, 1.055 * np.maximum(rolled, 1e-9) ** (1 / 2.4) - 0.055
    )
    return np.asarray(np.floor(curved * 255 + 0.5), np.uint8)


def _srgb_table() -> Floats:
    code = np.arange(256) / 255
    return np.asarray(np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4))


SRGB_TO_LINEAR: Final = _srgb_table()
