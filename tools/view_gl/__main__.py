"""`python -m gstream_tools.view_gl`: options, one-line errors, exit codes."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ..reader_py import CorruptFileError, UnsupportedError
from ..scene import RefusedSceneError, SceneError, explain

if TYPE_CHECKING:
    from .session import Session

MISSING = "pip install 'gstream[gl]'"
WINDOW_SAMPLES = 4  # of a command that says nothing of samples; pictures without a window take one
EXAMPLES = """examples:
  python -m gstream_tools.view_gl scan.gsb
  python -m gstream_tools.view_gl https://example.org/scan.gsb --scene evening.toml
  python -m gstream_tools.view_gl scan.gsb --offscreen scan.png --camera fit:35,18,2
  python -m gstream_tools.view_gl scan.gsb --path flight.json --frames flight --sync

exit codes: 0 done, 1 our error, 2 usage, 3 stopped, 4 an invalid file, scene or script,
6 unsupported (no OpenGL, a column that is missing, an effect that cannot be shown)"""


class CommandError(Exception):
    """The end of a command: one line, and the exit code."""

    def __init__(self, said: str, code: int) -> None:
        super().__init__(said, code)
        self.said, self.code = said, code


class Parser(argparse.ArgumentParser):
    """Errors in one line."""

    def error(self, message: str) -> NoReturn:
        raise CommandError(f"{message}; see --help", 2)


def parser() -> Parser:
    """The options; README.md has them too."""
    options = Parser(
        prog="python -m gstream_tools.view_gl",
        description="Show a block file: in a window, or as pictures.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = options.add_argument
    add("file", nargs="?", metavar="FILE|URL", help="the block file; may be named by the scene")
    add("--scene", metavar="S.toml", help="lights, camera, shading: spec/scene.md")
    add(
        "--explain", action="store_true", help="say which effects the scene calls for; draw nothing"
    )
    add("--size", type=_size, default=(1280, 720), metavar="WxH", help="pixels (1280x720)")
    add(
        "--camera",
        metavar="C",
        help="fit:AZIMUTH,ELEVATION[,ZOOM] or x,y,z:x,y,z[:FOV]: eye, target",
    )
    add("--pixel-error", type=_error, metavar="P", help="pixels that a voxel may be long")
    add("--samples", type=int, choices=(1, 2, 4, 8), metavar="N", help="of a pixel: 1, 2, 4, 8")
    add("--levels", action="store_true", help="colour by level")
    add("--sync", action="store_true", help="each frame waits for all that it needs")
    add("--offscreen", metavar="OUT.png", help="write one picture, and end")
    add("--path", metavar="SCRIPT.json", help="a camera script, with --frames")
    add("--frames", metavar="FOLDER", help="of the script's pictures and frames.jsonl")
    add("--force", action="store_true", help="replace a picture or frames that exist")
    add("--json", action="store_true", help="say what was drawn as JSON, on stdout")
    add("-q", "--quiet", action="store_true", help="say nothing but errors")
    add("--window-frames", type=int, default=0, help=argparse.SUPPRESS)
    return options


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    if not all(1 <= side <= 16_384 for side in size):
        raise argparse.ArgumentTypeError(f"{text!r} is no size; give WxH, 1 to 16384 each")
    return size


def _error(text: str) -> float:
    try:
        error = float(text)
    except ValueError:
        error = -1.0
    if not 0 <= error <= 1024:
        raise argparse.ArgumentTypeError(f"{text!r} is not from 0 to 1024")
    return error


def main(arguments: Sequence[str]) -> int:
    """Run one command line; the exit code."""
    try:
        return run(arguments)
    except CommandError as error:
        return _fail(error.said, error.code)
    except KeyboardInterrupt:
        return _fail("stopped", 3)
    except Exception as error:
        said = f"{type(error).__name__}: {error}; an error of ours: please report it"
        return _fail(f"{said} with what GSTREAM_DEBUG=1 shows", 1)


def run(arguments: Sequence[str]) -> int:
    """errors : CommandError"""
    options = parser().parse_args(arguments)
    if (options.path is None) != (options.frames is None):
        raise CommandError("--path and --frames go together; give both", 2)
    if options.path and options.offscreen:
        raise CommandError("--path and --offscreen exclude each other; give one", 2)
    try:
        from .offscreen import NoOpenGLError
        from .script import ScriptError
        from .session import Session, UsageError, Wishes
    except ModuleNotFoundError as error:
        raise CommandError(f"{error.name} is missing; {MISSING}", 2) from error
    alone = bool(options.offscreen or options.path)
    wishes = Wishes(
        options.scene, options.camera, options.samples, options.pixel_error,
        options.sync or bool(options.offscreen),
    )  # fmt: skip
    width, height = options.size
    try:
        session = Session.open(options.file, wishes, width / height, 1 if alone else WINDOW_SAMPLES)
        try:
            return _show(session, options)
        finally:
            session.file.close()
    except UsageError as error:
        raise CommandError(str(error), 2) from error
    except RefusedSceneError as error:
        raise CommandError(str(error), 6) from error
    except (SceneError, ScriptError) as error:
        raise CommandError(str(error), 4) from error
    except (CorruptFileError, UnsupportedError) as error:
        code = 4 if isinstance(error, CorruptFileError) else 6
        raise CommandError(f"{options.file or options.scene}: {error}", code) from error
    except NoOpenGLError as error:
        raise CommandError(str(error), 6) from error
    except OSError as error:
        said = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        raise CommandError(said, 2) from error


def _show(session: Session, options: argparse.Namespace) -> int:
    if options.explain:
        _explain(session, options.json)
    elif options.offscreen:
        _picture(session, options)
    elif options.path:
        _film(session, options)
    else:
        from .window import Window

        Window(session, options.size, tint=options.levels).run(options.window_frames)
    return 0


def _explain(session: Session, as_json: bool) -> None:
    found = session.resolution
    if as_json:
        names = ("effects", "columns", "passes", "defines")
        print(json.dumps({name: getattr(found, name) for name in names}, indent=1))
    else:
        print(explain(found))


def _picture(session: Session, options: argparse.Namespace) -> None:
    from . import offscreen
    from .record import Pace, picture

    _absent(Path(options.offscreen), options.force)
    pace = Pace(options.quiet)
    with offscreen.context() as context:
        renderer = session.renderer(context, options.size, tint=options.levels)
        said = picture(renderer, session.camera, options.offscreen, pace)
    if options.json:
        print(json.dumps(said, indent=1))
    elif not options.quiet:
        print(_line(said))


def _film(session: Session, options: argparse.Namespace) -> None:
    from . import offscreen
    from .record import Pace, film
    from .script import read_script

    folder, script = Path(options.frames), read_script(options.path)
    _absent(folder / "frames.jsonl", options.force)
    folder.mkdir(parents=True, exist_ok=True)
    pace = Pace(options.quiet)
    with offscreen.context() as context:
        renderer = session.renderer(context, options.size, tint=options.levels)
        try:
            film(session, renderer, script, folder, options.sync, pace)
        finally:
            renderer.close()
    if not options.quiet:
        print(f"{folder}: {script.frames} frames, {pace.seconds:.1f} s")


def _line(said: dict[str, Any]) -> str:
    width, height = said["size"]
    error = f"{said['pixel_error']:g} pixels"
    return (
        f"{said['picture']}: {width}x{height}, {said['voxels']:,} voxels of {said['blocks']:,} "
        f"blocks, finest level {said['deepest']} of {said['levels']}; {said['read_bytes']:,} of "
        f"{said['file_bytes']:,} bytes in {said['requests']} requests; voxels of at most {error}; "
        f"{said['seconds']:.1f} s in {said['frames']} frames"
        + ("" if said["converged"] else "; not finished: blocks come and go, budget.pool_bytes?")
    )


def _absent(path: Path, force: bool) -> None:
    if path.exists() and not force:
        raise CommandError(f"{path}: exists; name another, or --force", 2)


def _fail(said: str, code: int) -> int:
    if os.environ.get("GSTREAM_DEBUG"):
        traceback.print_exc()
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in said)
    print(f"view_gl: {shown}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
