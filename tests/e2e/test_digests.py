"""`gstream info --digests` of what was just made, beside spec/reference_decoder.py."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from .meshes import sphere, write_coloured_ply
from .program import succeed

DECODER = Path(__file__).parents[2] / "spec" / "reference_decoder.py"


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """A folder with a stream of double positions and colours, and a block file of four levels."""
    folder = tmp_path_factory.mktemp("made")
    points, triangles = sphere(24)
    colours = (127 * (points + 1)).astype(np.uint8)
    write_coloured_ply(folder / "a.ply", points, colours, triangles)
    succeed(folder, "ingest", "a.ply", "-o", "a.gst")
    options = ("--resolution", 64, "--block", 8, "--keep-weights")
    succeed(folder, "voxelize", "a.gst", "-o", "a.gsb", *options)
    return folder


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("a.gst", {"0", "2", "4"}),
        ("a.gsb", {"key", "occupancy", "mask", "normal", "colour", "weight"}),
    ],
)
def test_a_fresh_file_has_the_digests_that_the_reference_decoder_prints(made, name, columns):
    content = json.loads(succeed(made, "info", name, "--digests", "--json"))["content"]
    ran = subprocess.run(
        [sys.executable, DECODER, made / name], capture_output=True, text=True, check=True
    )
    assert content == json.loads(ran.stdout)
    assert {frozenset(level["columns"]) for level in content["levels"]} == {frozenset(columns)}


def test_digests_are_lines_of_text_too(made):
    content = json.loads(succeed(made, "info", "a.gsb", "--digests", "--json"))["content"]
    lines = succeed(made, "info", "a.gsb", "--digests").splitlines()
    for level in content["levels"]:
        assert f"digest {level['level']}         mask {level['columns']['mask']}" in lines


def test_without_digests_info_has_none(made):
    assert "content" not in json.loads(succeed(made, "info", "a.gsb", "--json"))
