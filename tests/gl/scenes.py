"""Meshes whose block files the viewer's tests draw, and what the meshes themselves look like."""

from dataclasses import dataclass
from pathlib import Path

import moderngl
import numpy as np

import gstream
from gstream_tools.reader_py import BlockFile, open_source
from gstream_tools.scene import resolve, scene_of
from gstream_tools.view_gl.camera import View, fit
from gstream_tools.view_gl.frame import Renderer
from gstream_tools.view_gl.session import facts_of

LIGHT = {"light": [{"direction": [-1, 1, -1.5]}], "budget": {"io": "sync"}}


def torus(bumps=0.15, around=96, across=48):
    """A closed torus with bumps, wound outwards: vertices and triangles."""
    u, v = np.meshgrid(
        np.arange(around) / around * 2 * np.pi,
        np.arange(across) / across * 2 * np.pi,
        indexing="ij",
    )
    tube = 0.4 + bumps * np.sin(7 * u) * np.sin(5 * v)
    points = np.stack(
        ((1 + tube * np.cos(v)) * np.cos(u), (1 + tube * np.cos(v)) * np.sin(u), tube * np.sin(v)),
        axis=-1,
    ).reshape(-1, 3)
    return points, _grid(around, across)


def strip(around=160, across=12):
    """A Möbius strip: one sheet, one side, a border."""
    u, v = np.meshgrid(
        np.arange(around + 1) / around * 2 * np.pi, np.linspace(-0.4, 0.4, across), indexing="ij"
    )
    reach = 1 + v * np.cos(u / 2)
    points = np.stack((reach * np.cos(u), reach * np.sin(u), v * np.sin(u / 2)), axis=-1)
    a = (np.arange(around)[:, None] * across + np.arange(across - 1)).ravel()
    quads = np.stack((a, a + across, a + across + 1, a + 1), axis=1)
    return points.reshape(-1, 3), np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def slab():
    """A closed box, its faces along the axes: each voxel of a face has that one direction."""
    points = np.array([(x, y, z) for z in (0, 0.31) for y in (0, 0.77) for x in (0, 1.0)])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return points, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def _grid(around, across):
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")

    def at(x, y):
        return (x % around * across + y % across).ravel()

    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    return np.concatenate((np.stack((a, b, c), 1), np.stack((a, c, d), 1)))


@dataclass(frozen=True)
class Model:
    """A mesh and its block file."""

    path: Path
    points: np.ndarray
    triangles: np.ndarray


def build(folder, name, mesh, **settings):
    """The model of a mesh; settings are those of gstream.build."""
    points, triangles = mesh
    source, path = folder / f"{name}.off", folder / f"{name}.gsb"
    lines = [f"OFF\n{len(points)} {len(triangles)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in triangles.tolist()]
    source.write_text("\n".join(lines) + "\n")
    gstream.build(str(source), str(path), workers=0, **settings)
    return Model(path, points, triangles)


def renderer(context, path, size=(160, 120), cut="shader", **tables):
    """A renderer of a file with a scene of these tables, synchronous but for what they say."""
    given = {
        name: dict(value) if isinstance(value, dict) else value for name, value in LIGHT.items()
    }
    for name, value in tables.items():
        given[name] = {**given.get(name, {}), **value} if isinstance(value, dict) else value
    scene = scene_of(given)
    file = BlockFile(open_source(str(path)))
    try:
        return Renderer(context, file, scene, resolve(scene, facts_of(file)), size, cut=cut)
    except BaseException:
        file.close()
        raise


def camera_from(file, direction, size, zoom=1.0, aside=(0.0, 0.0)):
    """A camera that sees the box from a direction, nearer by `zoom` and moved to the side."""
    camera = fit(
        file.box, np.asarray(direction, float), np.array([0.0, 0.0, 1.0]), size[0] / size[1]
    )
    extent = float(np.linalg.norm(file.box[1] - file.box[0]))
    return camera.zoom(zoom).move(aside[0] * extent, aside[1] * extent, 0.0)


MESH_VERTEX = """#version 450 core
in vec3 place;
uniform mat4 clip;
void main() { gl_Position = clip * vec4(place, 1.0); }
"""
MESH_FRAGMENT = """#version 450 core
layout(location = 0) out vec4 pixel;
void main() { pixel = vec4(1.0); }
"""


class Silhouette:
    """Which pixels the source mesh covers, drawn as triangles."""

    def __init__(self, context, model, file, size):
        self.context, self.size = context, size
        inverse = np.linalg.inv(np.vstack((file.matrix, (0, 0, 0, 1))))
        corners = model.points[model.triangles].reshape(-1, 3)
        grid = corners @ inverse[:3, :3].T + inverse[:3, 3]
        self.box = np.stack((grid.min(axis=0), grid.max(axis=0)))
        self.matrix = file.matrix
        self.program = context.program(vertex_shader=MESH_VERTEX, fragment_shader=MESH_FRAGMENT)
        data = context.buffer(np.ascontiguousarray(grid, np.float32).tobytes())
        self.array = context.vertex_array(self.program, [(data, "3f", "place")])
        self.frame = context.simple_framebuffer(size)

    def __call__(self, camera):
        view = View.of(camera, self.size, self.matrix, self.box)
        self.program["clip"].write(view.local(np.zeros(3, np.int64)).tobytes())
        self.frame.use()
        self.frame.clear()
        self.context.enable_only(moderngl.NOTHING)
        self.array.render(moderngl.TRIANGLES)
        data = np.frombuffer(self.frame.read(components=1), np.uint8)
        return data.reshape(self.size[1], self.size[0])[::-1] > 0


def eroded(mask, by=2):
    """The pixels whose neighbourhood of `by` pixels is all in the mask."""
    padded = np.pad(mask, by, constant_values=False)
    height, width = mask.shape
    shifts = [
        padded[dy : dy + height, dx : dx + width]
        for dy in range(2 * by + 1)
        for dx in range(2 * by + 1)
    ]
    return np.logical_and.reduce(shifts)


def holes(picture, silhouette):
    """How many pixels show the background inside the silhouette, eroded by two pixels."""
    return int((eroded(silhouette) & (picture[..., 3] < 255)).sum())
