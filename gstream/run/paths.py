"""What can be read, and where can be written: told before anything starts, one line each."""

import os
from collections.abc import Sequence
from pathlib import Path

from gstream.errors import UsageError
from gstream.run.journal import folder_name
from gstream.run.publish import is_finished
from gstream.source import is_url


def check_paths(
    inputs: Sequence[str], output: str, tmp: str | None, force: bool, restart: bool
) -> None:
    """Check what a job needs; tmp, force, restart : as in RunOptions.

    An output that a job stopped right after making it is no obstacle to that job.

    errors : UsageError for inputs that cannot be read and outputs that cannot be written
    """
    if not inputs:
        raise UsageError("there is no input", "name at least one file")
    for path in inputs:
        _check_input(path, output)
    place = scratch_place(output, tmp)
    left = Path(place, folder_name(output))
    try:
        _check_output(output, force or (is_finished(left, output) and not restart), folder=False)
    except UsageError as error:
        more = f", or drop what an earlier run has left: gstream clean {left}"
        raise UsageError(error.said, error.remedy + more * left.exists()) from None
    check_folder(place, "the folder for scratch" if tmp else "$TMPDIR")


def scratch_place(output: str, tmp: str | None) -> str:
    """The folder in which the job's folder is: --tmp, else $TMPDIR, else where the output is."""
    return tmp or os.environ.get("TMPDIR") or os.path.dirname(os.path.abspath(output))


def check_reading(blockfile: str, output: str, force: bool, folder: bool = False) -> None:
    """Check what makes one output of one block file or its URL; folder : the output is a folder.

    errors : UsageError for an input that cannot be read and an output that cannot be written
    """
    if not is_url(blockfile):
        _check_input(blockfile, output)
    _check_output(output, force, folder)


def _check_output(output: str, force: bool, folder: bool) -> None:
    check_folder(os.path.dirname(os.path.abspath(output)), "the output's folder")
    if os.path.isdir(output) and not folder:
        raise UsageError(f"{output}: is a folder", "name a file")
    if os.path.exists(output) and not force:
        raise UsageError(f"{output}: exists already", "add --force to replace it")


def _check_input(path: str, output: str) -> None:
    if os.path.isdir(path):
        raise UsageError(f"{path}: is a folder", "name the file in it")
    if not os.path.exists(path):
        raise UsageError(f"{path}: no such file", "check its name and folder")
    if not os.path.isfile(path):
        raise UsageError(f"{path}: is not a regular file", "copy it to a file first")
    try:
        open(path, "rb").close()
    except OSError as error:
        said = f"{path}: cannot be read: {os.strerror(error.errno or 0)}"
        raise UsageError(said, "check its permissions") from error
    if os.path.exists(output) and os.path.samefile(path, output):
        raise UsageError(f"{output}: is an input as well as the output", "name another output")


def check_folder(path: str, what: str) -> None:
    """errors : UsageError for a folder in which no file can be made; `what` it is"""
    if not os.path.isdir(path):
        raise UsageError(f"{path}: {what} does not exist", "create it first")
    if not os.access(path, os.W_OK | os.X_OK):
        raise UsageError(f"{path}: {what} cannot be written", "check its permissions")
