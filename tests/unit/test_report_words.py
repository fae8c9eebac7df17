"""The accuracy report's plan, prices and tables, on numbers that are made up."""

import json
from dataclasses import replace

import pytest

from gstream.errors import UsageError
from gstream.report.accuracy import plan_of
from gstream.report.knobs import knobs
from gstream.report.results import Plan, Point, Report, Series, as_dict
from gstream.report.words import markdown, price
from gstream_cli import main

KNOBS = {knob.name: knob for knob in knobs(128)}


def series(name, rows):
    """rows : (value, seconds, bytes, error)."""
    knob = KNOBS[name]
    points = []
    for value, seconds, size, error in rows:
        errors, differing = ({knob.error: error}, None) if knob.error else ({}, error)
        counts = {"fragments": 20, "voxels": 30, "bytes": size, "digest": ""}
        points.append(Point(value, value == knob.default, (seconds,), 0, counts, errors, differing))
    return Series("sphere", knob, tuple(points))


RESOLUTION = series("resolution", [(32, 1.0, 100, 4.0), (64, 4.0, 300, 2.0), (128, 16.0, 900, 1.0)])
SEP = series("sep", [("6", 1.0, 100, 0.15), ("26", 1.5, 150, 0.2), ("conservative", 2.0, 180, 0.0)])
CELL = series("cell", [(64, 2.0, 100, 0), (256, 1.0, 100, 0)])
EXACT = series(
    "classification", [("float32", 1.2, 0, 9), ("float64", 1.0, 0, 2), ("exact", 1.05, 0, 0)]
)
LZ4 = series("lz4", [("fast", 1.0, 100, 0), ("hc", 3.0, 90, 0)])
BROKEN = series("block", [(32, 2.0, 100, 7), (64, 1.0, 100, 0)])


@pytest.mark.parametrize(
    ("of", "said"),
    [
        (RESOLUTION, "halving the error costs 4 × time and 3 × bytes (32 to 128)"),
        (
            SEP,
            "from the default 6 to the most accurate, conservative: error 0.15 to 0, "
            "for 2 × time and 1.80 × bytes",
        ),
        (
            EXACT,
            "the default exact is the most accurate, for 1.05 × time of float64, whose error is 2",
        ),
        (CELL, "lossless: error exactly 0, the bytes are the same at all values"),
        (
            LZ4,
            "lossless: error exactly 0, the voxels are the same at all values; "
            "hc takes 0.90 × the default's bytes",
        ),
        (BROKEN, "NOT LOSSLESS: voxels that differ from the default's: 7 at 32"),
    ],
    ids=lambda value: value.knob.name if isinstance(value, Series) else "",
)
def test_the_price_in_words(of, said):
    assert price(of) == said


def test_a_ratio_of_times_on_whose_side_turns_disagree_is_not_told():
    seconds = {"6": (1.0, 2.0, 9.0), "26": (1.0, 2.0, 3.0), "conservative": (0.9, 2.2, 9.9)}
    points = [replace(p, all_seconds=seconds[p.value]) for p in SEP.points]
    said = price(replace(SEP, points=tuple(points)))
    assert said.endswith("error 0.15 to 0, for time within its spread and 1.80 × bytes")


def test_a_machine_that_slows_down_between_turns_changes_no_ratio():
    slow = {"float32": (1.0, 9.0, 5.0), "float64": (1.0, 10.0, 5.0), "exact": (1.02, 10.2, 5.1)}
    points = [replace(p, all_seconds=slow[p.value]) for p in EXACT.points]
    assert "1.02 × time of float64" in price(replace(EXACT, points=tuple(points)))


def test_the_front_leaves_out_what_another_point_beats_in_both():
    assert [point.value for point in SEP.front("seconds")] == ["6", "conservative"]
    assert [point.value for point in RESOLUTION.front("bytes")] == [32, 64, 128]


def test_the_report_has_every_point_and_is_json():
    scene = {"name": "sphere", "triangles": 10, "area": 1.0, "floor_voxels": 0.01}
    report = Report(Plan(("sphere",), 128, (KNOBS["sep"],), 1), (scene,), (SEP, CELL))
    held = json.loads(json.dumps(as_dict(report, ["a", "b"]), allow_nan=False))
    assert [len(s["points"]) for s in held["series"]] == [3, 2]
    assert held["series"][0]["points"][1]["fronts"] == []
    text = markdown(report)
    assert "| 6 (default) | 1 | 20 | 30 | 100 | 0.15 | seconds, bytes |" in text
    assert f"**{price(CELL)}**" in text


@pytest.mark.parametrize(
    ("scenes", "names", "runs", "said"),
    [
        ("large", (), 1, "there are no scenes 'large'; give one of small, all"),
        ("small", ("bits",), 1, "there is no knob 'bits'; give one of resolution, sep"),
        ("small", (), 0, "--runs 0 is out of range"),
    ],
)
def test_what_there_is_not_is_refused(scenes, names, runs, said):
    with pytest.raises(UsageError, match=said):
        plan_of(scenes, None, names, runs)


def test_an_unknown_knob_exits_with_2_and_writes_nothing(tmp_path, capsys):
    folder = tmp_path / "report"
    assert main.status(["report", "accuracy", "-o", str(folder), "--knob", "bits"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not folder.exists()


def test_help_has_two_examples(capsys):
    assert main.status(["report", "accuracy", "--help"]) == 0
    assert capsys.readouterr().out.split("Options:")[0].count("gstream report accuracy -o") == 2
