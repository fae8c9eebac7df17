"""`gstream report accuracy`, as a user runs it."""

import json

import numpy as np
from display import need_opengl
from e2e.meshes import write_ply
from e2e.program import fail, succeed


def test_a_small_report_is_written_and_finer_normals_are_better(tmp_path):
    said = succeed(
        tmp_path, "report", "accuracy", "-o", "out", "--knob", "normal-bits", "--knob", "cell",
        "--runs", "1", "--json",
    )  # fmt: skip
    held = json.loads((tmp_path / "out" / "report.json").read_text())
    assert json.loads(said) == held
    bits, cell = held["series"]
    means = [point["errors"]["normal_mean"] for point in bits["points"]]
    assert means == sorted(means, reverse=True)
    assert means[0] < 0.4  # 8 bits: 0.39 degrees at most, and what a curved voxel adds
    assert all(point["differing"] == 0 for point in cell["points"])
    assert cell["price"].startswith("lossless: error exactly 0")
    assert all(point["errors"]["distance_max"] < 0.87 for point in bits["points"])


def test_a_user_s_own_mesh_is_its_own_true_surface(tmp_path):
    corners = np.array([[0, 0, 0], [9, 1, 2], [2, 8, 1], [1, 3, 7]], float)
    write_ply(tmp_path / "own.ply", corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    succeed(
        tmp_path, "report", "accuracy", "own.ply", "-o", "out", "--knob", "lz4", "--knob",
        "face-threshold", "--runs", "1", "--quiet",
    )  # fmt: skip
    held = json.loads((tmp_path / "out" / "report.json").read_text())
    faces, lz4 = held["series"]
    assert {one["scene"] for one in held["series"]} == {"own.ply"}
    for point in lz4["points"]:
        errors = point["errors"]
        assert (point["differing"], errors["leaks"]) == (0, 0)
        assert (
            errors["misclassified"] < 1e-3 * point["counts"]["voxels"]
        )  # those that snapping moves
        assert errors["distance_max"] < 0.87
        assert errors["normal_mean"] < 2.0  # at edges a voxel has the mean of two faces
    assert faces["points"][0]["errors"]["faces_missing"] < 0.01
    assert not faces["option"]


def test_a_file_that_is_no_mesh_leaves_no_report(tmp_path):
    (tmp_path / "notes.ply").write_text("to do: buy milk\n")
    line = fail(tmp_path, 4, "report", "accuracy", "notes.ply", "-o", "out", "--quiet")
    assert "notes.ply" in line
    assert not list((tmp_path / "out").iterdir())


def test_smaller_pixel_errors_draw_more_voxels_and_occlusion_changes_no_pixel(tmp_path):
    need_opengl()
    succeed(
        tmp_path, "report", "accuracy", "-o", "out", "--knob", "pixel-error", "--knob", "occlusion",
        "--runs", "1", "--quiet",
    )  # fmt: skip
    held = json.loads((tmp_path / "out" / "report.json").read_text())
    error, occlusion = held["series"]
    assert held["notes"] == []
    assert [point["value"] for point in error["points"]] == [8, 1, 0.25]
    for count in ("voxels", "bytes"):
        counts = [point["counts"][count] for point in error["points"]]
        assert counts == sorted(set(counts))
    errors = [point["errors"]["image_rms"] for point in error["points"]]
    assert errors[0] > 2 * errors[1] > 0
    assert [point["differing"] for point in occlusion["points"]] == [0, 0]
    assert occlusion["price"].startswith("lossless: error exactly 0, the pixels are the same")
