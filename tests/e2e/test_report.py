"""`gstream report accuracy`, as a user runs it."""

import json

from e2e.program import succeed


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
