"""The installed program, run the way a user runs it."""

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = Path(sys.executable).with_name("gstream")
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "TMPDIR"}


def gstream(
    folder: Path, *arguments: object, timeout: float = 600
) -> subprocess.CompletedProcess[str]:
    """Run `gstream` in `folder`; a time-out is a hang, not a measurement."""
    command = [str(PROGRAM), *map(str, arguments)]
    return subprocess.run(
        command,
        cwd=folder,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


def succeed(folder: Path, *arguments: object) -> str:
    """Run `gstream`, which must succeed; its stdout."""
    done = gstream(folder, *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def fail(folder: Path, status: int, *arguments: object) -> str:
    """Run `gstream`, which must fail with `status` and exactly one line; that line."""
    done = gstream(folder, *arguments)
    assert done.returncode == status, done.stderr
    assert done.stderr.startswith("gstream: ")
    assert done.stderr.count("\n") == 1, done.stderr
    return done.stderr
