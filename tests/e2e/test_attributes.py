"""Colours, normals and masks from a mesh on disk to the voxels of a block file."""

from pathlib import Path
from typing import Any

import numpy as np

import gstream

SQUARE = "v 0 0 0\nv 1 0 0.03\nv 1 1 0.07\nv 0 1 0.04\n"


def voxels(folder: Path, mesh: Path, **settings: Any) -> dict[str, np.ndarray[Any, Any]]:
    """Positions, masks, normals and colours of the finest voxels of `mesh`."""
    output = folder / "out.gsb"
    gstream.build(mesh, output, workers=0, force=True, **{"resolution": 64, **settings})
    with gstream.open(output) as file:
        blocks = list(file.blocks(0))
        held = {
            "place": np.concatenate([b.positions() for b in blocks]),
            "mask": np.concatenate([b.mask for b in blocks]),
            "normal": np.concatenate([b.normals() for b in blocks]),
        }
        if "colour" in file.columns:
            held["colour"] = np.concatenate([b.colour for b in blocks])
    return held


def test_the_normals_of_a_plane_are_its_normal_to_the_stated_angle(tmp_path):
    mesh = tmp_path / "plane.obj"
    mesh.write_text(SQUARE + "f 1 2 3 4\n")
    held = voxels(tmp_path, mesh)
    normal = np.array([-0.03, -0.04, 1.0])
    cosine = held["normal"] @ normal / np.linalg.norm(normal)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.08 + 0.01  # snapping adds 0.01
    assert set(held["mask"]) == {0b100101}  # -x, -y, +z


def test_faces_of_both_sides_set_both_bits_of_an_axis(tmp_path):
    mesh = tmp_path / "plane.obj"
    mesh.write_text("v 0 0 0.5\nv 1 0 0.5\nv 1 1 0.5\nf 1 2 3\n")
    assert set(voxels(tmp_path, mesh)["mask"]) == {0b100000}
    assert set(voxels(tmp_path, mesh, faces="both")["mask"]) == {0b110000}


def test_input_normals_replace_the_geometric_ones_and_leave_the_masks(tmp_path):
    mesh = tmp_path / "plane.obj"
    normals = "vn 1 0 0\n" * 4
    mesh.write_text(SQUARE + normals + "f 1//1 2//2 3//3 4//4\n")
    held = voxels(tmp_path, mesh, normals="input")
    np.testing.assert_allclose(held["normal"], np.tile([1.0, 0, 0], (len(held["mask"]), 1)))
    assert set(held["mask"]) == {0b100101}


def test_vertex_colours_run_linearly_in_light_over_a_triangle(tmp_path):
    mesh = tmp_path / "ramp.obj"
    mesh.write_text(
        "v 0 0 0 0 0 0\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\nv 0 1 0 0 0 0\nf 1 2 3\nf 1 3 4\n"
    )
    held = voxels(tmp_path, mesh)
    share = (held["place"][:, 0] + 0.5) / 64
    code = held["colour"][:, 0] / 255
    light = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    assert np.abs(light - share).max() < 0.02  # the margin of the grid and one code near white
    assert (held["colour"][:, 3] == 255).all()


def test_colours_of_faces_stay_apart_but_for_the_voxels_they_share(tmp_path):
    mesh = tmp_path / "two.off"
    points = "0 0 0.2\n1 0 0.2\n1 1 0.2\n0 1 0.2\n"
    mesh.write_text("OFF\n4 2 0\n" + points + "3 0 1 2 255 0 0\n3 0 2 3 0 0 255\n")
    held = voxels(tmp_path, mesh)
    x, y = held["place"][:, 0], held["place"][:, 1]
    assert (held["colour"][x > y] == [255, 0, 0, 255]).all()
    assert (held["colour"][x < y] == [0, 0, 255, 255]).all()
    shared = held["colour"][x == y].astype(int)
    assert np.abs(shared[:, 0] - shared[:, 2]).max() < 16  # half of each
    assert shared[:, 0].min() > 150


def test_one_colour_is_stored_as_a_constant_and_takes_no_column(tmp_path):
    mesh = tmp_path / "red.off"
    mesh.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 200 10 20\n")
    held = voxels(tmp_path, mesh)
    assert (held["colour"] == [200, 10, 20, 255]).all()
    with gstream.open(tmp_path / "out.gsb") as file:
        assert all(view.stored("colour") == b"" for view in file.blocks(0))


def test_opposite_faces_cancel_to_no_direction_and_keep_both_sides_visible(tmp_path):
    mesh = tmp_path / "sheet.obj"
    mesh.write_text("v 0 0 0.5\nv 1 0 0.5\nv 1 1 0.5\nf 1 2 3\nf 3 2 1\n")
    held = voxels(tmp_path, mesh)
    assert not held["normal"].any()
    assert set(held["mask"]) == {0b110000}
