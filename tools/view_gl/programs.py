"""Programs put together from `shaders/`, with the defines that a scene calls for and no others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files

import moderngl

VERSION = "#version 450 core\n"  # what llvmpipe offers; nothing here needs more
FLAG_GROUP = 8  # flag.comp's local size
CUT_GROUP = 64  # cut.comp's

# The parts of each stage, joined in this order.
FACES = (
    ("common", "stencil", "srgb", "shade", "voxel.vert"),
    ("common", "faces.geom"),
    ("faces.frag",),
)
SPRITES = (
    ("common", "stencil", "srgb", "shade", "sprite", "voxel.vert"),
    (),
    ("common", "sprite.frag"),
)
# Probes and shadows have no colour: only the depth test, and flags, which early tests guard.
DEPTHS = (("common", "stencil", "voxel.vert"), ("common", "faces.geom"), ("depths.frag",))
PIECES = (("common", "piece.vert"), ("common", "srgb", "shade", "piece.geom"), ("faces.frag",))
COLOUR_DEFINES = ("COLOUR", "LIT", "SPECULAR", "SHADOW", "LIGHTS", "TINT")
# What is drawn as the screen's triangle, by the last part's name.
SCREEN = {
    "cleared.frag": ("cleared.frag",),
    "numbered.frag": ("common", "srgb", "shade", "numbered.frag"),
    "reconstruct.frag": ("srgb", "reconstruct.frag"),
    "resolve.frag": ("srgb", "resolve.frag"),
}


class Programs:
    """Compiles programs, and keeps what was compiled with which defines, for whoever asks."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self.compiled: list[tuple[str, dict[str, int]]] = []

    def faces(self, defines: Mapping[str, int]) -> moderngl.Program:
        """Voxels as faces from a geometry shader."""
        if "SRAA" in defines:  # colours come later
            defines = _without_colour(defines)
        return self._program("faces", FACES, defines)

    def sprites(self, defines: Mapping[str, int]) -> moderngl.Program:
        """Voxels as points whose fragments meet a ray with a box."""
        return self._program("sprites", SPRITES, {**defines, "SPRITES": 1})

    def depths(self, name: str, defines: Mapping[str, int]) -> moderngl.Program:
        """Faces without colour: a light's depths, or with OCCLUSION the probes."""
        plain = {key: value for key, value in defines.items() if key != "SRAA"}
        return self._program(name, DEPTHS, {**_without_colour(plain), "DEPTHS": 1})

    def pieces(self, defines: Mapping[str, int]) -> moderngl.Program:
        """Source triangles."""
        return self._program("pieces", PIECES, defines)

    def screen(self, name: str, defines: Mapping[str, int]) -> moderngl.Program:
        """A pass over the screen's pixels."""
        return self._program(name, (("screen.vert",), (), SCREEN[name]), defines)

    def compute(self, parts: Sequence[str], defines: Mapping[str, int]) -> moderngl.ComputeShader:
        """A compute shader, named by its last part."""
        self.compiled.append((parts[-1], dict(defines)))
        return self._context.compute_shader(_source(parts, defines))

    def _program(
        self, name: str, stages: Sequence[Sequence[str]], defines: Mapping[str, int]
    ) -> moderngl.Program:
        self.compiled.append((name, dict(defines)))
        vertex, geometry, fragment = (_source(parts, defines) for parts in stages)
        return self._context.program(
            vertex_shader=vertex, geometry_shader=geometry or None, fragment_shader=fragment
        )


def _without_colour(defines: Mapping[str, int]) -> dict[str, int]:
    return {key: value for key, value in defines.items() if key not in COLOUR_DEFINES}


def _source(parts: Sequence[str], defines: Mapping[str, int]) -> str:
    if not parts:
        return ""
    folder = files(__package__) / "shaders"
    text = [VERSION, *(f"#define {name} {value}\n" for name, value in sorted(defines.items()))]
    for part in parts:
        name = part if "." in part else f"{part}.glsl"
        text.append((folder / name).read_text(encoding="utf-8"))
    return "".join(text)
