"""Names appear whole or not at all; a unit is done only while its files are."""

import json
from pathlib import Path

import pytest

from gstream.job import Job, Unit
from gstream.run.publish import Scratch, publish

UNIT = Unit("stage", "u0")


def job_in(folder: Path) -> Job:
    return Job(folder=str(folder), output=str(folder / "out"), stream=str(folder / "out"))


def test_a_published_file_appears_only_when_it_is_complete(tmp_path):
    path = tmp_path / "a.bin"
    with publish(path) as file:
        file.write(b"half")
        file.flush()
        assert not path.exists()
    assert path.read_bytes() == b"half"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_write_that_fails_leaves_neither_name_nor_remains(tmp_path, error):
    with pytest.raises(error), publish(tmp_path / "a.bin") as file:
        file.write(b"half")
        raise error
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_keeps_the_file_that_was_there(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    with pytest.raises(ValueError, match="half"), publish(path) as file:
        file.write(b"new")
        raise ValueError("half")
    assert path.read_bytes() == b"old"


def test_scratch_reads_ranges_and_refuses_to_read_past_the_end(tmp_path):
    with Scratch(job_in(tmp_path)) as scratch:
        with scratch.write("deep/down/a") as file:
            file.write(b"0123456789")
        assert scratch.read("deep/down/a", 2, 3) == b"234"
        assert scratch.read("deep/down/a", 7) == b"789"
        assert scratch.read("deep/down/a", 10, 0) == b""
        with pytest.raises(EOFError, match="wanted 4 bytes at 8, got 2"):
            scratch.read("deep/down/a", 8, 4)


def test_a_unit_is_done_while_its_files_have_their_lengths(tmp_path):
    with Scratch(job_in(tmp_path)) as scratch:
        assert scratch.done(UNIT) is None
        with scratch.write("a") as file:
            file.write(b"abc")
        scratch.mark_done(UNIT, {"voxels": 3}, ("a",))
        assert scratch.done(UNIT) == {"voxels": 3}
        scratch.path("a").write_bytes(b"ab")
        assert scratch.done(UNIT) is None
        scratch.path("a").unlink()
        assert scratch.done(UNIT) is None


def test_a_unit_whose_file_has_other_bytes_is_done_only_for_who_does_not_read_it(tmp_path):
    with Scratch(job_in(tmp_path)) as scratch:
        with scratch.write("a") as file:
            file.write(b"123456789")
        scratch.mark_done(UNIT, {}, ("a",))
        marker = json.loads((tmp_path / "stage/u0.done").read_text())
        assert marker["crcs"] == {"a": 0xCBF43926}  # the check value of CRC-32
        assert scratch.done(UNIT, paranoid=True) == {}
        scratch.path("a").write_bytes(b"123456780")
        assert scratch.done(UNIT) == {}
        assert scratch.done(UNIT, paranoid=True) is None


def test_a_damaged_marker_means_not_done(tmp_path):
    with Scratch(job_in(tmp_path)) as scratch:
        scratch.mark_done(UNIT, {})
    (tmp_path / "stage/u0.done").write_bytes(b'{"counts"')
    with Scratch(job_in(tmp_path)) as scratch:
        assert scratch.done(UNIT) is None
