"""Files of later versions are told from damaged ones."""

import runpy
from pathlib import Path

import pytest
from conformance.later_vectors import LATER, VECTORS

import gstream
from gstream.check import check_file
from gstream.errors import UnsupportedError
from gstream.formats.stream import StreamReader

RUN = runpy.run_path(str(Path(__file__).parents[2] / "spec" / "conformance" / "run.py"))


def test_the_folder_holds_these_vectors_and_they_are_good_ones_but_for_what_is_later():
    found = {path.name: path.read_bytes() for path in (VECTORS / "later").iterdir()}
    assert found == {name: make() for name, make in LATER.items()}


@pytest.mark.parametrize("name", LATER)
def test_reading_and_checking_a_later_file_ends_in_exit_code_6(name):
    path = VECTORS / "later" / name
    with pytest.raises(UnsupportedError) as read:
        StreamReader(path) if path.suffix == ".gst" else gstream.open(path)
    with pytest.raises(UnsupportedError) as checked:
        check_file(path)
    assert read.value.exit_code == checked.value.exit_code == 6


def test_a_reader_that_takes_a_later_file_for_a_damaged_one_is_none():
    expected = {"valid": False, "codes": ["unsupported"], "reader": "refuse"}
    fault = RUN["reader_fault"]
    assert fault(expected, {"valid": False, "codes": ["unsupported"]}) is None
    assert "it is later, not damaged" in fault(expected, {"valid": False, "codes": ["GSB-0105"]})
    assert "it is later, not damaged" in fault(expected, {"valid": True, "codes": []})
