"""A job's folder: what names it, what keeps it, what removes it."""

import json
from pathlib import Path

import pytest

from gstream.errors import InputError, StoppedError, UsageError
from gstream.run.budget import MIB, plan_memory
from gstream.run.journal import SAMPLE_BYTES, SAMPLES, Identity, fingerprint, job_folder

GIB = 1 << 30


def identity(**changes: object) -> Identity:
    parts = {
        "stages": ("spill", "ingest"),
        "settings": {"ingest": {"order": "file"}},
        "inputs": {"/a.ply": "5-abc"},
        "output": "/out.gst",
        "version": "0.1.0",
    }
    return Identity(**{**parts, **changes})  # type: ignore[arg-type]


def folders(tmp: Path) -> list[str]:
    return sorted(path.name for path in tmp.iterdir())


def test_the_folder_name_is_frozen_for_given_settings():
    assert identity().folder_name() == "gstream-489ef512321fde40"


@pytest.mark.parametrize(
    "change",
    [
        {"stages": ("spill",)},
        {"settings": {}},
        {"inputs": {"/a.ply": "5-abd"}},
        {"output": "/other.gst"},
        {"version": "0.2.0"},
    ],
)
def test_whatever_decides_the_bytes_changes_the_folder(change):
    assert identity(**change).folder_name() != identity().folder_name()


def test_a_finished_job_leaves_nothing(tmp_path):
    with job_folder(tmp_path, identity(), 2 * GIB, 2) as folder:
        assert json.loads((folder.path / "job.json").read_bytes())["job"]["output"] == "/out.gst"
        assert not folder.resumed
    assert folders(tmp_path) == []


def test_a_stopped_job_is_resumed_with_its_files_and_its_plan(tmp_path):
    with (
        pytest.raises(StoppedError, match=r"again \(scratch: .*gstream-"),
        job_folder(tmp_path, identity(), 2 * GIB, 2) as first,
    ):
        (first.path / "work").write_text("done")
        raise StoppedError("stopped", "run again")
    with job_folder(tmp_path, identity(), 2 * GIB, 8) as second:
        assert second.resumed
        assert (second.path / "work").read_text() == "done"
        assert second.plan == first.plan
        assert second.workers == 2


def test_a_stopped_job_starts_over_where_its_units_no_longer_fit(tmp_path):
    with pytest.raises(StoppedError), job_folder(tmp_path, identity(), 8 * GIB, 1) as first:
        (first.path / "work").write_text("done")
        raise StoppedError("stopped", "run again")
    with job_folder(tmp_path, identity(), 600 * MIB, 1) as second:
        assert not second.resumed
        assert not (second.path / "work").exists()
        assert second.plan == plan_memory(600 * MIB, 1)


def test_a_job_with_a_bad_input_leaves_nothing(tmp_path):
    with pytest.raises(InputError), job_folder(tmp_path, identity(), 2 * GIB, 2):
        raise InputError("a.ply", "", "is empty", "copy it again")
    assert folders(tmp_path) == []


def test_a_bug_keeps_the_folder(tmp_path):
    with pytest.raises(ZeroDivisionError), job_folder(tmp_path, identity(), 2 * GIB, 2):
        raise ZeroDivisionError
    assert folders(tmp_path) == [identity().folder_name()]


def test_a_second_run_of_a_running_job_is_refused_and_harms_nothing(tmp_path):
    with job_folder(tmp_path, identity(), 2 * GIB, 2) as folder:
        with (
            pytest.raises(UsageError, match="this job is running already"),
            job_folder(tmp_path, identity(), 2 * GIB, 2),
        ):
            pass
        assert (folder.path / "job.json").exists()


def test_a_fingerprint_knows_size_head_tail_and_samples_but_no_time(tmp_path):
    path = tmp_path / "a"
    data = bytearray(SAMPLE_BYTES * (SAMPLES + 2) * 3)
    path.write_bytes(data)
    before = fingerprint(path)
    path.touch()
    assert fingerprint(path) == before
    for at in (0, len(data) - 1):
        changed = bytearray(data)
        changed[at] = 1
        path.write_bytes(changed)
        assert fingerprint(path) != before
    unseen = bytearray(data)
    unseen[SAMPLE_BYTES] = 1
    path.write_bytes(unseen)
    assert fingerprint(path) == before
    assert fingerprint(path, whole=True) != before
    path.write_bytes(bytes(len(data) - 1))
    assert fingerprint(path) != before


def test_a_small_file_is_fingerprinted_whole(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(bytes(1000))
    before = fingerprint(path)
    path.write_bytes(bytes(500) + b"\1" + bytes(499))
    assert fingerprint(path) != before
