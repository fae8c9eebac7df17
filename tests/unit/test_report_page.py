"""The report's page, with matplotlib and without."""

import pytest

from gstream.report import page
from gstream.report.knobs import knobs
from gstream.report.results import Plan, Point, Report, Series
from unit.test_report_words import CELL, KNOBS, SEP

REPORT = Report(Plan(("sphere",), 128, (KNOBS["sep"], KNOBS["cell"]), 1), (), (SEP, CELL))


def test_each_knob_has_a_picture_its_price_and_a_table():
    pytest.importorskip("matplotlib")
    text = page.html(REPORT)
    assert text.count("<svg") == text.count("<table") == 2
    assert page.price(SEP) in text
    assert "pip install" not in text


def test_a_picture_that_streams_nothing_is_drawn_at_0_bytes():
    pytest.importorskip("matplotlib")
    knob = next(knob for knob in knobs(128) if knob.name == "refine")
    counts = {"frames": 2, "largest": 0}
    points = [Point(v, v == knob.default, (), 0, counts, {}, 0) for v in knob.values]
    text = page.html(Report(Plan(("sphere",), 128, (knob,), 1), (), (Series("a", knob, points),)))
    assert text.count("<svg") == 1


def test_without_matplotlib_there_are_tables_and_a_line_that_says_so(monkeypatch):
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    text = page.html(REPORT)
    assert (text.count("<svg"), text.count("<table")) == (0, 2)
    assert text.count("pip install") == 1
