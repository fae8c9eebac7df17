"""The viewer's knobs in the accuracy report: errors of pictures, and what is measured where."""

from subprocess import CompletedProcess

import numpy as np
import pytest
from PIL import Image

from gstream.errors import GstreamError
from gstream.report import accuracy, views
from gstream.report.knobs import knobs, shown
from gstream.report.results import as_dict
from gstream.report.truth.pictures import (
    differing_pixels,
    flicker,
    picture_errors,
    read_picture,
    shortfall,
)
from gstream.report.words import markdown, price

GREY, BLUE = (188, 188, 188), (0, 0, 128)
VIEWED = ("pixel-error", "samples", "sraa", "occlusion", "refine", "upload-per-frame")


def picture(*rows):
    return np.array(rows, np.uint8)


def test_half_a_pixel_is_compared_with_half_the_light_of_both():
    """IEC 61966-2-1: half the light of code 188 has code 137.0, of code 128 has code 92.4."""
    finer = picture([GREY, BLUE, GREY, GREY], [GREY, BLUE, GREY, GREY])
    errors = picture_errors(picture([(137, 137, 160), GREY]), finer)
    blue = 255 * (1.055 * ((0.502886 + 0.215861) / 2) ** (1 / 2.4) - 0.055)
    assert errors["edge_rms"] == pytest.approx(abs(160 - blue) / 3**0.5, abs=0.05)
    assert errors["image_rms"] == pytest.approx(errors["edge_rms"] / 2**0.5, rel=1e-6)


def test_pixels_without_the_object_are_in_no_error():
    finer = picture([BLUE, BLUE, GREY, BLUE], [BLUE, BLUE, GREY, BLUE])
    good = picture([BLUE, (137, 137, 161)])
    wrong = picture([GREY, (137, 137, 161)])
    assert picture_errors(wrong, finer) == picture_errors(good, finer)


def test_pixels_differ_in_any_channel_and_count_once(tmp_path):
    one = picture([GREY, BLUE], [BLUE, GREY])
    other = one.copy()
    other[0, 0], other[1, 0, 2] = 0, 129
    Image.fromarray(other).save(tmp_path / "other.png")
    assert differing_pixels(one, read_picture(tmp_path / "other.png")) == 2


def test_what_changes_evenly_does_not_flicker_and_what_blinks_does():
    even = [picture([(40 + 8 * i, 90, 90), BLUE]) for i in range(9)]
    assert flicker(even) == 0
    assert flicker([picture([(30 if i % 2 else 40, 0, 0)]) for i in range(9)]) == (400 / 3) ** 0.5
    assert flicker([picture([GREY, BLUE])] * 3) == 0


def test_an_object_of_which_half_is_late_by_two_frames_lacks_a_whole_picture():
    half, wrong, whole = picture([GREY, BLUE, BLUE]), [(9, 9, 9), GREY, BLUE], [GREY, GREY, BLUE]
    assert shortfall([half, half, picture(whole)]) == {"holes": 1.0, "unfinished": 1.0}
    assert shortfall([half, picture(wrong), picture(whole)]) == {"holes": 0.5, "unfinished": 1.0}


def test_the_small_scenes_are_viewed_only_where_a_knob_of_the_viewer_is_named():
    assert not [knob for knob in accuracy.plan_of("small", None, (), 1).knobs if knob.key]
    named = accuracy.plan_of("small", None, VIEWED, 1).knobs
    assert [len(knob.values) for knob in named] == [3, 3, 2, 2, 2, 2]
    assert all(knob.default in knob.values for knob in named)
    every = {knob.name for knob in accuracy.plan_of("all", None, (), 1).knobs}
    assert every == {knob.name for knob in knobs(256)} >= set(VIEWED)


def test_values_are_shown_as_words_and_sizes():
    known = {knob.name: knob for knob in knobs(256)}
    assert [shown(known["occlusion"], value) for value in (False, True)] == ["off", "on"]
    assert shown(known["upload-per-frame"], 1 << 18) == "256KiB"


@pytest.fixture
def viewer(monkeypatch):
    """A viewer that draws nothing: `answer(changed, frames)` gives the lines and the picture."""

    def install(answer, most=4):
        held = {}

        def film(self, changed, frames, finer=1, turn=0.0):
            lines, held["picture"] = answer(changed, frames, finer)
            return lines

        monkeypatch.setattr(views, "prepared", lambda *_: (views.SCENES["sphere"](4), ""))
        monkeypatch.setattr(views, "fresh", lambda *_: {})
        monkeypatch.setattr(views.Views, "_most_samples", lambda self: most)
        monkeypatch.setattr(views.Views, "_film", film)
        monkeypatch.setattr(views.Views, "_picture", lambda self, frames: held["picture"])

    return install


def still(milliseconds, colour=GREY):
    line = {"voxels": 7, "uploaded": 64, "read_bytes": 900, "cpu_milliseconds": milliseconds}
    first = {**line, "cpu_milliseconds": 1e6}  # it reads
    return [first, line, line, {**line, "uploaded": 0}], picture([colour])


def measured(*names):
    plan = accuracy.plan_of("small", None, names, 1)
    return accuracy.measure(plan, lambda event: None)


def test_a_frame_s_seconds_are_those_of_frames_that_read_nothing(viewer):
    viewer(lambda changed, frames, finer: still(250.0))
    (series,) = measured("occlusion").series
    assert [(p.seconds, p.counts["bytes"]) for p in series.points] == [(0.25, 192)] * 2
    assert price(series).startswith("lossless: error exactly 0, the pixels are the same")


def test_a_pixel_that_occlusion_changes_is_told(viewer):
    def answer(changed, frames, finer):
        return still(1.0, GREY if changed["budget.occlusion"] else BLUE)

    viewer(answer)
    (series,) = measured("occlusion").series
    assert price(series) == "NOT LOSSLESS: pixels that differ from the default's: 1 at off"


def test_samples_that_the_driver_does_not_have_are_not_turned(viewer):
    def answer(changed, frames, finer):
        lines, _ = still(1.0)
        size = (4, 4, 3) if finer > 1 else (1, 1, 3)
        drawn = np.full(size, 188, np.uint8)
        drawn[:, : size[1] // 2] = BLUE
        return lines, drawn

    viewer(answer, most=4)
    (series,) = measured("samples").series
    assert [point.value for point in series.points] == [1, 4]


def test_frames_are_drawn_until_the_picture_is_final_and_the_largest_is_told(viewer):
    def answer(changed, frames, finer):
        sizes = [900, 0, 300, *[100] * 17, *[0] * frames][:frames]
        lines = [{"converged": i > 20, "uploaded": size} for i, size in enumerate(sizes)]
        return lines, picture([GREY])

    viewer(answer)
    (series,) = measured("refine").series
    assert series.points[0].counts == {"frames": 22, "largest": 300}


@pytest.fixture
def ends_with(monkeypatch):
    """The viewer, as a program that ends with a code and a line."""

    def install(code, said):
        monkeypatch.setattr(views, "prepared", lambda *_: (views.SCENES["sphere"](4), ""))
        monkeypatch.setattr(views, "fresh", lambda *_: {})
        ended = CompletedProcess([], code, stdout="", stderr=f"view_gl: {said}\n")
        monkeypatch.setattr(views, "run", lambda *_, **__: ended)

    return install


@pytest.mark.parametrize(("code", "said"), [(2, "moderngl is missing"), (6, "no OpenGL 4.5")])
def test_without_opengl_a_line_says_so_and_the_report_is_written(ends_with, code, said):
    ends_with(code, said)
    report = measured("occlusion")
    note = f"the viewer's knobs are left out: {said}"
    assert (report.series, as_dict(report, [])["notes"]) == ((), [note])
    assert note in markdown(report)


def test_a_viewer_that_fails_ends_the_report(ends_with):
    ends_with(1, "ValueError: nan")
    with pytest.raises(GstreamError, match="a run of the viewer failed: view_gl: ValueError: nan"):
        measured("occlusion")
