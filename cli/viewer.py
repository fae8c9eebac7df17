"""`gstream view`: hands over to the OpenGL viewer, a program that knows the spec alone."""

import os
import sys
from importlib.util import find_spec
from typing import NoReturn

import click

from gstream.errors import UsageError

PROGRAM = "gstream_tools.view_gl"


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument(
    "arguments", nargs=-1, type=click.UNPROCESSED, metavar="FILE.gsb|URL [VIEWER'S OPTIONS]..."
)
def view(arguments: tuple[str, ...]) -> NoReturn:
    """Show a block file in a window, or draw pictures without one.

    Needs OpenGL 4.5: pip install 'gstream[gl]'. Reads only what the picture shows; H lists the
    keys.

    \b
    gstream view scan.gsb
    gstream view https://example.org/scan.gsb --scene evening.toml
    gstream view scan.gsb --offscreen scan.png --camera fit:35,18,2 --size 1920x1080
    gstream view scan.gsb --path flight.json --frames flight --sync

    \b
    --scene S.toml        lights, camera, shading (spec/scene.md)
    --explain             which effects the scene calls for; draws nothing
    --size WxH            pixels
    --camera C            fit:AZIMUTH,ELEVATION[,ZOOM], or x,y,z:x,y,z[:FOV], eye and target
    --pixel-error P       pixels that a voxel may be long
    --samples N           of a pixel: 1, 2, 4, 8
    --levels              colour by level
    --sync                each frame waits for all that it needs
    --offscreen OUT.png   one picture, no window
    --path S.json --frames FOLDER   the frames of a camera script
    --force, --json, --quiet        as of other commands
    """
    if find_spec("moderngl") is None or find_spec("glfw") is None:
        raise UsageError("the viewer needs moderngl and glfw", "pip install 'gstream[gl]'")
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", PROGRAM, *arguments])
