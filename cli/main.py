"""The script `gstream`: its commands, and the one place where an error becomes an exit code."""

import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module

import click

from gstream import __version__
from gstream.errors import GstreamError, StoppedError, UsageError

from .shown import shown

COMMANDS = {  # command -> module of this package; imported when it is called
    "ingest": "convert",
    "voxelize": "convert",
    "build": "convert",
    "simplify": "convert",
    "status": "jobs",
    "resume": "jobs",
    "clean": "jobs",
    "info": "inspect",
    "check": "inspect",
    "preview": "inspect",
    "view": "viewer",
    "export": "content",
    "diff": "content",
    "report": "accuracy",
}


class LazyGroup(click.Group):
    """A group whose commands are imported when asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f".{COMMANDS[cmd_name]}", __package__)
        command: click.Command = getattr(module, cmd_name)
        return command


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Exit codes: 0 done, 1 our error, 2 usage, 3 stopped (run again, or `gstream resume`), "
    "4 invalid input, 5 refused (memory, disk), 6 unsupported, 7 different (diff).",
)
@click.version_option(__version__, prog_name="gstream", message="%(prog)s %(version)s")
@click.option("--debug", is_flag=True, help="Show tracebacks.  [env: GSTREAM_DEBUG]")
@click.pass_context
def main(ctx: click.Context, debug: bool) -> None:
    """Turn meshes that do not fit in memory into one streamable block file.

    \b
    gstream build scan.ply -o scan.gsb --resolution 2048
    gstream check scan.gsb
    gstream preview scan.gsb -o scan.png
    """
    if debug:
        os.environ["GSTREAM_DEBUG"] = "1"


def run() -> None:
    """Entry point of the script."""
    sys.exit(status(sys.argv[1:]))


def status(arguments: Sequence[str]) -> int:
    """Run one command line; the exit status of architecture.md section 7."""
    try:
        returned = main.main(arguments, prog_name="gstream", standalone_mode=False)
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit):
        # The reader of our output has left (`gstream info … | head`): nothing is wrong. Click
        # turns that into SystemExit(1), and raises no other one outside its standalone mode.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 0
    except (KeyboardInterrupt, click.Abort):
        return _fail("stopped; run the same command again to resume", StoppedError.exit_code)
    except click.ClickException as error:
        return _fail(_usage_line(error), UsageError.exit_code)
    except GstreamError as error:
        return _fail(str(error), error.exit_code)
    except Exception as error:
        notes = getattr(error, "__notes__", [])  # where the job's folder is kept
        said = " ".join(" ".join((f"{type(error).__name__}: {error}", *notes)).split())
        return _fail(f"{said}; an error of ours: please report it with --debug's output", 1)
    return returned if isinstance(returned, int) else 0


def _usage_line(error: click.ClickException) -> str:
    said = " ".join(error.format_message().split()).rstrip(".")
    path = (
        error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "gstream"
    )
    return f"{said}; see '{path} --help'"


def _fail(said: str, code: int) -> int:
    """One line on stderr; the traceback too where it was asked for."""
    if os.environ.get("GSTREAM_DEBUG"):
        traceback.print_exc()
        print(getattr(sys.exception(), "trace", ""), file=sys.stderr, end="")  # a worker's
    print(f"gstream: {shown(said)}", file=sys.stderr)
    return code
