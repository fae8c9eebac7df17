"""A block file with its scene and first camera: everything that a picture needs before OpenGL.

Defaults of what neither scene nor command says are here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, radians, sin
from pathlib import Path
from typing import Any, Self

import moderngl
import numpy as np
from numpy.typing import NDArray

from ..reader_py import BlockFile, open_source
from ..scene import Facts, Resolution, Scene, SceneError, read_scene, resolve, scene_of
from .camera import FIT_MARGIN, Camera, fit
from .frame import Renderer

Floats = NDArray[np.float64]

STEEPEST = 89.999  # degrees: a camera that looks straight down has no upright direction
SHOULDER = (-0.6, 0.8, 1.0)  # the default light comes from there: to the right, up, backwards
GEOMETRY = range(32, 48)  # ids of columns that hold source triangles, spec/blockfile.md 12


class UsageError(Exception):
    """A command that cannot be carried out as it was given; one line that says what to do."""


@dataclass(frozen=True, slots=True)
class Wishes:
    """What a command says about a scene; None where it leaves that to the scene."""

    scene: str | None = None  # path of a scene file
    camera: str | None = None  # as `camera_of_text` reads it
    samples: int | None = None  # of each pixel
    pixel_error: float | None = None  # pixels
    sync: bool = False  # each frame waits for all that it needs


@dataclass(frozen=True, slots=True)
class Session:
    """What is looked at, and from where at first."""

    file: BlockFile
    scene: Scene
    resolution: Resolution
    camera: Camera

    @classmethod
    def open(
        cls, place: str | None, wishes: Wishes, aspect: float, default_samples: int = 1
    ) -> Self:
        """Read head and opening run: two requests at most.

        place : path or URL of the block file; None: the one that the scene names
        aspect : width over height of the picture
        default_samples : of a command without scene and samples
        errors : SceneError, UsageError, OSError, and those of reader_py
        """
        scene = read_scene(wishes.scene) if wishes.scene else None
        file = BlockFile(open_source(place or _named(scene)))
        try:
            file.load_opening()
            camera = _camera(scene or scene_of({}, file.source.name), file, aspect, wishes.camera)
            scene = scene or default_scene(file, camera, default_samples)
            scene = _overridden(scene, wishes)
            facts = facts_of(file)
            resolution = resolve(scene, facts)
            scene = _coloured(scene, file) if facts.constant_colour else scene
        except BaseException:
            file.close()
            raise
        return cls(file, scene, resolution, camera)

    def renderer(
        self, context: moderngl.Context, size: tuple[int, int], *, tint: bool = False
    ) -> Renderer:
        """size : pixels; tint : colour by level"""
        return Renderer(context, self.file, self.scene, self.resolution, size, tint=tint)


def facts_of(file: BlockFile) -> Facts:
    """What head and opening run say of a file.

    That all voxels have one colour is known only of a file with one page: others would be read
    for nothing.
    """
    names = frozenset(file.columns.values())
    geometry = {"geometry"} if any(number in GEOMETRY for number in file.columns) else set()
    return Facts(
        columns=names | geometry,
        levels=file.levels,
        blocks=file.blocks,
        voxels=sum(file.level_voxels),
        constant_colour=constant_colour(file) is not None,
    )


def constant_colour(file: BlockFile) -> int | None:
    """The packed colour that all voxels have, as far as `facts_of` looks."""
    if "colour" not in file.columns.values() or file.pages != 1:
        return None
    entries = file.page(0)
    first = None
    for entry in entries[entries["state"] > 0]:
        colour = file.constant(entry, "colour")
        if colour is None or colour != (colour if first is None else first):
            return None
        first = colour
    return first


def default_scene(file: BlockFile, camera: Camera, samples: int = 1) -> Scene:
    """The scene of a command without one: a lamp over the viewer's left shoulder."""
    given: dict[str, Any] = {"camera": {"samples": samples}}
    if "normal" in file.columns.values():
        towards = np.array(SHOULDER) @ camera.axes()
        given |= {"light": [{"direction": (-towards).tolist()}], "shade": {"ambient": 0.25}}
    else:
        given |= {"shade": {"model": "flat"}}
    return scene_of(given, file.source.name)


def scene_camera(scene: Scene, file: BlockFile, aspect: float) -> Camera:
    """The scene's camera (spec/scene.md 2.3), fitted where the scene does not place it.

    errors : SceneError for one that looks nowhere, or along its up
    """
    said = scene.camera
    up = np.array(said.up) if said.up else up_axis(file)
    if said.position is None:
        direction = _direction(up, said.azimuth, said.elevation)
        camera = fit(file.box, direction, up, aspect, said.fov)
        if said.target is not None:
            position = np.add(camera.position, np.subtract(said.target, camera.target))
            camera = replace(camera, position=_point(position), target=said.target)
    else:
        target = said.target or _point(file.box.mean(axis=0))
        camera = Camera(said.position, target, _point(up), said.fov)
        if not _upright(camera):
            wrong = "is the target, or the camera looks along its up"
            raise SceneError(scene.path, "camera.position", wrong, "give another place")
    if said.projection == "orthographic":
        camera = replace(camera, height=said.height or fitted_height(camera, file.box, aspect))
    return camera


def camera_of_text(text: str, scene: Scene, file: BlockFile, aspect: float) -> Camera:
    """ "fit:AZIMUTH,ELEVATION[,ZOOM]", or "x,y,z:x,y,z[:FOV]", the eye and its target.

    scene : has the rest
    errors : UsageError; SceneError as of `scene_camera`
    """
    parts = [part.split(",") for part in text.removeprefix("fit:").split(":")]
    try:
        numbers = [tuple(map(float, part)) for part in parts]
    except ValueError:
        numbers = []
    sizes = [len(part) for part in numbers]
    if not np.isfinite([n for part in numbers for n in part]).all():
        sizes = []
    if text.startswith("fit:") and sizes in ([2], [3]):
        azimuth, elevation, zoom = (*numbers[0], 1.0)[:3]
        said = replace(
            scene.camera, azimuth=azimuth, elevation=elevation, position=None, target=None
        )
        if abs(elevation) <= 90 and zoom > 0:
            return scene_camera(replace(scene, camera=said), file, aspect).zoom(zoom)
    if not text.startswith("fit:") and sizes in ([3, 3], [3, 3, 1]):
        fov = numbers[2][0] if len(numbers) == 3 else scene.camera.fov
        eye, target = (_point(np.array(place)) for place in numbers[:2])
        said = replace(scene.camera, position=eye, target=target, fov=fov)
        if 1 <= fov <= 170:
            return scene_camera(replace(scene, camera=said), file, aspect)
    raise UsageError(
        f"camera {text!r} is not understood; give fit:AZIMUTH,ELEVATION[,ZOOM] (elevation -90 to "
        "90, zoom above 0) or x,y,z:x,y,z[:FOV], the eye and what it looks at (fov 1 to 170)"
    )


def refit(camera: Camera, box: Floats, aspect: float) -> Camera:
    """A camera that looks the same way, and sees the whole box (2, 3)."""
    fitted = fit(box, camera.axes()[2], np.array(camera.up), aspect, camera.fov)
    return replace(fitted, height=camera.height and fitted_height(fitted, box, aspect))


def fitted_height(camera: Camera, box: Floats, aspect: float) -> float:
    """What a parallel projection shows from bottom to top when the box fills it."""
    right, above, _ = np.abs(camera.axes())
    edges = box[1] - box[0]
    return float(max(edges @ above, edges @ right / aspect)) * FIT_MARGIN or 1.0


def up_axis(file: BlockFile) -> Floats:
    """The direction that the file says is up; z where it says none."""
    said = str(file.metadata.get("up") or "z").lower()
    axis = "xyz".find(said[-1:])
    if axis < 0 or said[:-1] not in ("", "+", "-"):
        return np.array([0.0, 0.0, 1.0])
    direction: Floats = np.eye(3)[axis] * (-1 if said.startswith("-") else 1)
    return direction


def _direction(up: Floats, azimuth: float, elevation: float) -> Floats:
    """From the object towards the camera: from the front at 0, from the right at 90 degrees."""
    up = up / np.linalg.norm(up)
    right = np.array([1.0, 0.0, 0.0]) - up[0] * up
    if np.linalg.norm(right) < 1e-6:
        right = np.array([0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    behind = np.cross(up, right)
    turn, lift = radians(azimuth), radians(min(max(elevation, -STEEPEST), STEEPEST))
    level: Floats = cos(lift) * (sin(turn) * right - cos(turn) * behind)
    return level + sin(lift) * up


def _upright(camera: Camera) -> bool:
    sight = np.subtract(camera.target, camera.position)
    across = float(np.linalg.norm(np.cross(sight, camera.up)))
    return across > 1e-9 * float(np.linalg.norm(sight) * np.linalg.norm(camera.up))


def _named(scene: Scene | None) -> str:
    """The block file that a scene names, relative to the scene's folder."""
    if scene is None or not scene.source.file:
        raise UsageError("no block file is named; give FILE or URL, or source.file in the scene")
    name = scene.source.file
    if name.lower().startswith(("http://", "https://")):
        return name
    return str(Path(scene.path).parent / name)


def _camera(scene: Scene, file: BlockFile, aspect: float, text: str | None) -> Camera:
    if text is None:
        return scene_camera(scene, file, aspect)
    try:
        return camera_of_text(text, scene, file, aspect)
    except SceneError as error:  # no scene has said that
        raise UsageError(f"camera {text!r}: {error.said}; {error.remedy}") from None


def _overridden(scene: Scene, wishes: Wishes) -> Scene:
    if wishes.samples is not None:
        scene = replace(scene, camera=replace(scene.camera, samples=wishes.samples))
    if wishes.pixel_error is not None:
        scene = replace(scene, lod=replace(scene.lod, pixel_error=wishes.pixel_error))
    if wishes.sync:
        scene = replace(scene, budget=replace(scene.budget, io="sync"))
    return scene


def _coloured(scene: Scene, file: BlockFile) -> Scene:
    """A constant colour is read from no column: it is the colour of the surface."""
    packed = constant_colour(file)
    if packed is None or scene.source.colours == "none":
        return scene
    red, green, blue = ((packed >> shift & 255) / 255 for shift in (0, 8, 16))
    return replace(scene, shade=replace(scene.shade, colour=(red, green, blue)))


def _point(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
