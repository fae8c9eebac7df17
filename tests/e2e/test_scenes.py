"""What a scene calls for and what the file then has: no more, no less, and nothing else."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from display import need_opengl
from e2e.meshes import sphere, write_coloured_ply, write_ply
from e2e.program import fail, succeed

import gstream
from gstream.digests import block_file_content
from gstream.errors import UnsupportedError

SUN = "[[light]]\ndirection = [-1, 1, -2]\n"
NO_COLOURS = '[source]\ncolours = "none"\n'
FINEST = "[lod]\npixel_error = 0\n"
FLAT = '[shade]\nmodel = "flat"\n'
SCENES = {  # name -> scene, columns beside occupancy and mask of a coloured mesh, levels
    "empty": ("", {"colour"}, True),
    "sun": (SUN, {"normal", "colour"}, True),
    "black sun": (SUN + "intensity = 0\n", {"colour"}, True),
    "flat": (SUN + FLAT, {"colour"}, True),
    "grey": (SUN + NO_COLOURS, {"normal"}, True),
    "shape": (NO_COLOURS, set(), True),
    "shadow of a shape": (NO_COLOURS + SUN + "shadows = true\n", {"normal"}, True),
    "finest": (SUN + FINEST, {"normal", "colour"}, False),
    "finest shape": (NO_COLOURS + FINEST, set(), False),
    "finest, streamed": (FINEST + '[budget]\nstreaming = "always"\n', {"colour"}, True),
    "coloured": ('[source]\ncolours = "required"\n' + FLAT, {"colour"}, True),
    "hybrid": ("[hybrid]\nenabled = true\n" + NO_COLOURS, {"vertex", "triangle"}, True),
    "samples": ("[camera]\nsamples = 4\nsraa = true\n", {"colour"}, True),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a plain and a coloured sphere, their streams, and whole block files."""
    made = tmp_path_factory.mktemp("scenes")
    points, triangles = sphere(rings=40)
    codes = np.random.default_rng(7).integers(0, 256, (len(points), 3), np.uint8)
    write_ply(made / "plain.ply", points, triangles)
    write_coloured_ply(made / "coloured.ply", points, codes, triangles)
    for name in ("plain", "coloured"):
        succeed(made, "ingest", f"{name}.ply", "-o", f"{name}.gst")
        build(made, name, "whole.gsb", None)
        (made / "whole.gsb").rename(made / f"{name}.gsb")
    return made


def build(folder: Path, mesh: str, output: str, scene: str | None, **settings: Any) -> set[str]:
    """The columns of a block file that is built for a scene."""
    path = None if scene is None else folder / "scene.toml"
    if path:
        path.write_text(scene)
    small: dict[str, Any] = {"resolution": 70, "block": 8, "cell": 16, **settings}
    source, made = folder / f"{mesh}.ply", folder / output
    gstream.build(source, made, scene=path, workers=0, force=True, **small)
    with gstream.open(folder / output) as file:
        return set(file.columns)


@pytest.mark.parametrize("name", SCENES)
def test_a_file_has_exactly_the_columns_and_levels_that_its_scene_calls_for(folder, name):
    scene, columns, levels = SCENES[name]
    assert build(folder, "coloured", "out.gsb", scene) == {"occupancy", "mask"} | columns
    with gstream.open(folder / "out.gsb") as file:
        assert file.levels == (5 if levels else 1)


# Source triangles bring blocks that the whole file, which has none, lacks.
@pytest.mark.parametrize("name", sorted(SCENES.keys() - {"hybrid"}))
def test_what_a_file_has_is_what_the_whole_file_has(folder, name):
    build(folder, "coloured", "out.gsb", SCENES[name][0])
    wanted = block_file_content(folder / "coloured.gsb")["levels"]
    for level in block_file_content(folder / "out.gsb")["levels"]:
        whole = wanted[level["level"]]
        assert (level["blocks"], level["voxels"]) == (whole["blocks"], whole["voxels"])
        assert level["columns"].items() <= whole["columns"].items()


@pytest.mark.parametrize("name", SCENES)
def test_a_file_for_a_scene_breaks_no_rule(folder, name):
    build(folder, "coloured", "out.gsb", SCENES[name][0])
    report = gstream.check(folder / "out.gsb")
    assert report.ok, list(report.findings)


def test_a_file_whose_levels_average_nothing_is_checkable_without_weights(folder):
    build(folder, "coloured", "out.gsb", NO_COLOURS)
    assert list(gstream.check(folder / "out.gsb").findings) == []


def test_a_scene_stores_colours_only_where_the_source_has_them(folder):
    assert build(folder, "plain", "out.gsb", SUN) == {"occupancy", "mask", "normal"}


def test_weights_are_kept_for_a_scene_when_they_are_asked_for(folder):
    columns = build(folder, "plain", "out.gsb", NO_COLOURS, keep_weights=True)
    assert columns == {"occupancy", "mask", "weight"}
    assert gstream.check(folder / "out.gsb").ok


def test_without_levels_a_scene_is_that_of_one_level(folder):
    build(folder, "plain", "out.gsb", "", lod=False)
    with gstream.open(folder / "out.gsb") as file:
        assert (file.levels, set(file.columns)) == (1, {"occupancy", "mask"})


def test_a_stream_is_voxelized_for_a_scene_as_its_mesh_is_built(folder):
    build(folder, "coloured", "built.gsb", SUN)
    size = ("--resolution", 70, "--block", 8, "--cell", 16)
    succeed(
        folder, "voxelize", "coloured.gst", "-o", "out.gsb", *size, "--scene", "scene.toml",
        "--force", "--workers", 2,
    )  # fmt: skip
    assert (folder / "out.gsb").read_bytes() == (folder / "built.gsb").read_bytes()


def test_levels_are_rebuilt_of_a_file_without_normals(folder):
    build(folder, "coloured", "finest.gsb", NO_COLOURS + FINEST)
    build(folder, "coloured", "levels.gsb", NO_COLOURS)
    succeed(folder, "simplify", "finest.gsb", "-o", "out.gsb", "--force")
    assert (folder / "out.gsb").read_bytes() == (folder / "levels.gsb").read_bytes()


def test_an_explanation_says_what_is_stored_and_why_and_a_dry_one_does_nothing_else(folder):
    (folder / "scene.toml").write_text(SUN)
    before = sorted(folder.iterdir())
    said = succeed(
        folder, "voxelize", "coloured.gst", "-o", "new.gsb", "--resolution", 70,
        "--scene", "scene.toml", "--explain", "--dry-run",
    )  # fmt: skip
    assert "\ncolumns  occupancy mask normal colour\n" in said
    assert next(line for line in said.splitlines() if line.startswith("lit ")).endswith("normal")
    assert "disk" not in said
    assert sorted(folder.iterdir()) == before


def test_an_explained_build_builds(folder):
    (folder / "scene.toml").write_text(NO_COLOURS)
    said = succeed(
        folder, "build", "coloured.ply", "-o", "out.gsb", "--resolution", 70,
        "--scene", "scene.toml", "--explain", "--force",
    )  # fmt: skip
    assert "columns  occupancy mask\n" in said
    assert "bytes per voxel of level 0" in said


@pytest.mark.parametrize(
    ("scene", "status", "said"),
    [
        ("[camera]\naperture = 1\n", 6, "scene.toml: lens: depth of field needs rays; use a ray-c"),
        ("[camera]\nfovv = 1\n", 4, "scene.toml: camera.fovv: is no such key; known are position"),
        ("camera =", 4, "scene.toml: is no TOML: "),
        ('[source]\ncolours = "required"\n', 6, "scene.toml: colour: the source has no colour; "),
        (None, 2, "scene.toml: no such file; "),
    ],
)
def test_a_scene_that_cannot_be_had_is_refused_in_one_line(folder, scene, status, said):
    (folder / "scene.toml").unlink(missing_ok=True)
    if scene is not None:
        (folder / "scene.toml").write_text(scene)
    line = fail(
        folder, status, "voxelize", "plain.gst", "-o", "new.gsb", "--resolution", 70,
        "--scene", "scene.toml",
    )  # fmt: skip
    assert line.startswith(f"gstream: {said}")
    assert not (folder / "new.gsb").exists()


def test_colours_that_a_scene_requires_are_missed_when_the_meshes_were_read(folder):
    with pytest.raises(UnsupportedError, match="has no colour, which the scene requires"):
        build(folder, "plain", "new.gsb", '[source]\ncolours = "required"\n', restart=True)


def test_there_is_nothing_to_explain_without_a_scene(folder):
    wanted = "--explain explains a scene; give one with --scene FILE"
    arguments = ("plain.gst", "-o", "new.gsb", "--resolution", 70, "--explain")
    assert wanted in fail(folder, 2, "voxelize", *arguments)


@pytest.mark.parametrize("name", ["sun", "grey", "flat", "shape", "finest shape"])
def test_a_file_for_a_scene_looks_in_it_as_the_whole_file_does(folder, name):
    need_opengl()
    from PIL import Image  # of the extra gl

    build(folder, "coloured", "out.gsb", SCENES[name][0])
    pictures = []
    for file in ("coloured.gsb", "out.gsb"):
        seen = ("--scene", "scene.toml", "--size", "120x90", "--sync", "--force", "--quiet")
        succeed(folder, "view", file, "--offscreen", "out.png", *seen)
        pictures.append(np.asarray(Image.open(folder / "out.png")))
    np.testing.assert_array_equal(*pictures)
    assert len(np.unique(pictures[0].reshape(-1, 3), axis=0)) > 1
