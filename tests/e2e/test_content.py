"""What is in a block file, as a user takes it out, compares it and reads it from a server."""

import json

import numpy as np
import pytest
from e2e.meshes import sphere, write_ply
from e2e.program import fail, gstream, succeed
from range_server import serving


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A sphere built with two sizes of blocks, and with another mode."""
    made = tmp_path_factory.mktemp("content")
    write_ply(made / "sphere.ply", *sphere())
    build = ("build", "sphere.ply", "--resolution", 64, "--workers", 0, "--quiet", "-o")
    succeed(made, *build, "large.gsb", "--block", 32)
    succeed(made, *build, "small.gsb", "--block", 8)
    succeed(made, *build, "thick.gsb", "--block", 32, "--sep", "conservative")
    return made


def test_exported_points_lie_on_the_sphere_with_its_normals(folder):
    said = json.loads(succeed(folder, "export", "large.gsb", "-o", "points.npz", "--json"))
    arrays = np.load(folder / "points.npz")
    matrix = arrays["matrix"]
    centres = (arrays["positions"] + 0.5) @ matrix[:, :3].T + matrix[:, 3]
    radius = np.linalg.norm(centres, axis=1)
    assert said["voxels"] == len(centres) > 5_000
    assert np.abs(radius - 1).max() < 1.5 * matrix[0, 0]
    assert ((centres / radius[:, None] * arrays["normal"]).sum(axis=1) > 0.9).all()


def test_half_a_sphere_is_about_half_of_the_voxels(folder):
    whole = json.loads(succeed(folder, "export", "large.gsb", "-o", "whole.ply", "--json"))
    bounds = ("--bounds", "-2,-2,-2,0,2,2")
    half = json.loads(succeed(folder, "export", "large.gsb", "-o", "h.ply", "--json", *bounds))
    assert 0.49 < half["voxels"] / whole["voxels"] < 0.55


def test_an_existing_export_is_replaced_only_when_forced(folder):
    succeed(folder, "export", "large.gsb", "-o", "again.ply", "--quiet")
    before = (folder / "again.ply").read_bytes()
    assert "add --force" in fail(folder, 2, "export", "large.gsb", "-o", "again.ply")
    succeed(folder, "export", "large.gsb", "-o", "again.ply", "--force", "--cubes", "--quiet")
    assert len((folder / "again.ply").read_bytes()) > len(before)


def test_diff_sees_through_the_size_of_blocks_and_finds_another_mode(folder):
    said = succeed(folder, "diff", "large.gsb", "small.gsb")
    assert said.startswith("large.gsb and small.gsb: equal: ")
    assert said.endswith(
        "in 2 levels, mask, normal (made with other settings: block_edge, levels)\n"
    )
    done = gstream(folder, "diff", "large.gsb", "thick.gsb", "--json")
    assert (done.returncode, done.stderr) == (7, "")
    finest = json.loads(done.stdout)["levels"][0]
    assert finest["only_a"] == 0  # what is set by 6-separation, conservative sets too
    assert finest["only_b"] == finest["voxels_b"] - finest["voxels_a"] > 0


def test_the_commands_that_read_take_a_url(folder):
    pytest.importorskip("aiohttp", reason="the extra [remote] is not installed")
    with serving((folder / "large.gsb").read_bytes()) as site:
        assert json.loads(succeed(folder, "info", site.url, "--json"))["kind"] == "block file"
        assert "valid" in succeed(folder, "check", site.url)
        assert "equal" in succeed(folder, "diff", "large.gsb", site.url)
        succeed(folder, "export", site.url, "-o", "far.ply", "--level", 1, "--quiet")
        succeed(folder, "export", "large.gsb", "-o", "near.ply", "--level", 1, "--quiet")
        site.failures += [404]
        assert "404 Not Found" in fail(folder, 2, "info", site.url)
    assert (folder / "far.ply").read_bytes() == (folder / "near.ply").read_bytes()
