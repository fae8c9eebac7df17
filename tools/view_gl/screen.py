"""What a window shows: the renderer's picture, and text over it."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from .sraa import DeferredTarget
from .target import Target

FONT_PIXELS = 15
MARGIN = 12  # pixels, around the text and around its panel
PANEL, INK = (0, 0, 0, 190), (235, 235, 235, 255)

VERTEX = """#version 450 core
uniform vec4 place;  // left, bottom, width, height, in clip coordinates
out vec2 at;
void main()
{
    at = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(place.xy + at * place.zw, 0.0, 1.0);
}
"""
FRAGMENT = """#version 450 core
uniform sampler2D image;
in vec2 at;
out vec4 colour;
void main() { colour = texture(image, at); }
"""


class Screen:
    """The window's framebuffer.

    The picture goes through a texture: a window's own buffer may have depths of another form than
    the renderer's, and then nothing at all is copied to it.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._window = context.detect_framebuffer(0)
        program = context.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self._program = program
        self._quad = context.vertex_array(program, [], mode=moderngl.TRIANGLE_STRIP)
        self._picture: moderngl.Texture | None = None
        self._copy: moderngl.Framebuffer | None = None
        self._text = ""
        self._panel: moderngl.Texture | None = None

    def show(self, target: Target | DeferredTarget, text: str) -> None:
        """Fill the window with a picture of its size, and lay lines of text over it."""
        picture = self._copied(target)
        self._window.viewport = (0, 0, *target.size)
        self._window.use()
        self._context.enable_only(moderngl.NOTHING)
        self._draw(picture, (-1.0, -1.0, 2.0, 2.0))
        if not text:
            return
        panel = self._lettered(text)
        width, height = (
            2 * side / whole for side, whole in zip(panel.size, target.size, strict=True)
        )
        left, top = (2 * MARGIN / whole - 1 for whole in target.size)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._draw(panel, (left, -top - height, width, height))

    def _copied(self, target: Target | DeferredTarget) -> moderngl.Texture:
        if self._picture is None or self._copy is None or self._picture.size != target.size:
            for old in (self._copy, self._picture):
                if old is not None:
                    old.release()
            self._picture = self._context.texture(target.size, 4)
            self._copy = self._context.framebuffer([self._picture])
        target.copy_to(self._copy)
        return self._picture

    def _lettered(self, text: str) -> moderngl.Texture:
        if self._panel is None or text != self._text:
            if self._panel is not None:
                self._panel.release()
            pixels = panel(text)
            size = pixels.shape[1], pixels.shape[0]
            self._panel, self._text = self._context.texture(size, 4, pixels.tobytes()), text
        return self._panel

    def _draw(self, image: moderngl.Texture, place: tuple[float, float, float, float]) -> None:
        image.filter = moderngl.NEAREST, moderngl.NEAREST
        image.use(0)
        self._program["place"] = place
        self._quad.render(vertices=4)


def panel(text: str) -> NDArray[np.uint8]:
    """(height, width, 4) lines on a dark ground, the lowest row of pixels first."""
    font = ImageFont.load_default(FONT_PIXELS)
    lines = [line.partition("  ") for line in text.splitlines()]
    tab = max(font.getlength(line[0]) for line in lines) + 2 * MARGIN
    wide = tab + max(font.getlength(line[2].strip()) for line in lines)
    step = FONT_PIXELS * 1.4
    size = int(wide) + 2 * MARGIN, int(step * len(lines)) + 2 * MARGIN
    image = Image.new("RGBA", size, PANEL)
    draw = ImageDraw.Draw(image)
    for i, (left, _, right) in enumerate(lines):
        draw.text((MARGIN, MARGIN + i * step), left, INK, font)
        draw.text((MARGIN + tab, MARGIN + i * step), right.strip(), INK, font)
    return np.asarray(image)[::-1]
