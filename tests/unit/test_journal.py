"""A job's folder: what names it, what keeps it, what removes it."""

import json
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from gstream.errors import InputError, RefusedError, StoppedError, UsageError
from gstream.run.budget import MIB, plan_memory
from gstream.run.fingerprint import SAMPLE_BYTES, SAMPLES, fingerprint
from gstream.run.journal import Identity, JobFolder, folder_name, job_folder

GIB = 1 << 30


def identity(**changes: object) -> Identity:
    parts = {
        "stages": ("spill", "ingest"),
        "settings": {"ingest": {"order": "file"}, "voxelize": {}},
        "inputs": (("/a.ply", "5-abc"), ("/b.ply", "6-def")),
        "output": "/out.gst",
        "version": "0.1.0",
    }
    return Identity(**{**parts, **changes})  # type: ignore[arg-type]


def held(
    path: Path,
    memory: int = 2 * GIB,
    workers: int = 2,
    restart: bool = False,
    **changes: object,
) -> AbstractContextManager[JobFolder]:
    options = {"workers": workers, "memory": memory, "force": False, "paranoid": False}
    return job_folder(path / "gstream-x", identity(**changes), memory, options, restart)


def stop(path: Path, **options: object) -> JobFolder:
    """The folder of a job that was stopped, with a file in it."""
    with pytest.raises(StoppedError), held(path, **options) as folder:  # type: ignore[arg-type]
        (folder.path / "work").write_text("done")
        raise StoppedError("stopped", "run again")
    return folder


def folders(tmp: Path) -> list[str]:
    return sorted(path.name for path in tmp.iterdir())


def test_the_folder_name_is_frozen_for_a_given_output():
    assert folder_name("/out.gst") == "gstream-340113f3387d9882"


def test_the_folder_is_the_output_s_however_its_path_is_written(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert folder_name("x/../out.gst") == folder_name(str(tmp_path / "out.gst"))
    assert folder_name("out.gst") != folder_name("other.gst")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"version": "0.2.0"}, "gstream was 0.1.0, is 0.2.0"),
        (
            {"settings": {"ingest": {"order": "spatial"}, "voxelize": {}}},
            r"settings were [0-9a-f]{16}, are [0-9a-f]{16} \(order file, now spatial\)",
        ),
        ({"stages": ("spill",)}, r"settings were [0-9a-f]{16}, are [0-9a-f]{16};"),
        (
            {"inputs": (("/a.ply", "5-abd"), ("/b.ply", "6-def"))},
            "then /a.ply was 5-abc, is 5-abd;",
        ),
        ({"inputs": (("/a.ply", "5-abc"),)}, "/b.ply was 6-def, is no input"),
        ({"inputs": (("/b.ply", "6-def"), ("/a.ply", "5-abc"))}, "are in another order"),
    ],
    ids=["version", "settings", "stages", "input", "inputs", "order"],
)
def test_a_stopped_job_is_not_resumed_with_anything_else_than_it_had(tmp_path, change, said):
    folder = stop(tmp_path)
    with pytest.raises(UsageError, match=f"was stopped, and since .*{said}") as refused:
        held(tmp_path, **change).__enter__()
    assert "put that back to resume, or add --restart" in str(refused.value)
    assert (folder.path / "work").read_text() == "done"
    with held(tmp_path, restart=True, **change) as again:
        assert not again.resumed
        assert not (again.path / "work").exists()


def test_a_job_begun_with_samples_of_its_inputs_is_resumed_with_hashes_of_all_and_the_reverse(
    tmp_path,
):
    whole = (("/a.ply", "5-abc-012"), ("/b.ply", "6-def-345"))
    stop(tmp_path)
    stop(tmp_path, inputs=whole)
    with held(tmp_path) as folder:
        assert folder.resumed


def test_all_of_an_input_that_was_hashed_once_must_agree(tmp_path):
    stop(tmp_path, inputs=(("/a.ply", "5-abc-012"), ("/b.ply", "6-def-345")))
    stop(tmp_path)
    with pytest.raises(UsageError, match=r"/a\.ply was 5-abc-012, is 5-abc-013"):
        held(tmp_path, inputs=(("/a.ply", "5-abc-013"), ("/b.ply", "6-def-345"))).__enter__()


def test_a_finished_job_leaves_nothing(tmp_path):
    with held(tmp_path) as folder:
        assert json.loads((folder.path / "job.json").read_bytes())["job"]["output"] == "/out.gst"
        assert not folder.resumed
    assert folders(tmp_path) == []


def test_a_stopped_job_is_resumed_with_its_files_and_its_plan(tmp_path):
    first = stop(tmp_path)
    with held(tmp_path, workers=8) as second:
        assert second.resumed
        assert (second.path / "work").read_text() == "done"
        assert second.plan == first.plan
        assert second.workers == 2


def test_a_stopped_job_names_the_commands_that_resume_and_drop_it(tmp_path):
    with pytest.raises(StoppedError) as stopped, held(tmp_path):
        raise StoppedError("stopped", "run again")
    path = tmp_path / "gstream-x"
    assert str(stopped.value) == (
        f"stopped; run again (or: gstream resume {path}; to drop it: gstream clean {path})"
    )


def test_a_stopped_job_is_kept_where_its_units_no_longer_fit(tmp_path):
    first = stop(tmp_path, memory=8 * GIB, workers=1)
    with pytest.raises(RefusedError, match=r"600MiB is too little.*or --restart to start over"):
        held(tmp_path, memory=600 * MIB, workers=1).__enter__()
    assert (first.path / "work").read_text() == "done"
    with held(tmp_path, memory=600 * MIB, workers=1, restart=True) as second:
        assert second.plan == plan_memory(600 * MIB, 1)


def test_a_job_with_a_bad_input_leaves_nothing(tmp_path):
    with pytest.raises(InputError), held(tmp_path):
        raise InputError("a.ply", "", "is empty", "copy it again")
    assert folders(tmp_path) == []


def test_a_bug_keeps_the_folder_and_names_the_commands(tmp_path):
    with pytest.raises(ZeroDivisionError) as bug, held(tmp_path):
        raise ZeroDivisionError
    assert folders(tmp_path) == ["gstream-x"]
    assert "gstream resume" in bug.value.__notes__[0]


def test_a_second_run_of_a_running_job_is_refused_and_harms_nothing(tmp_path):
    with held(tmp_path) as folder:
        with pytest.raises(UsageError, match="this job is running already"), held(tmp_path):
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
    whole = fingerprint(path, whole=True)
    unseen[SAMPLE_BYTES] = 1
    path.write_bytes(unseen)
    assert fingerprint(path) == before
    assert fingerprint(path, whole=True) != whole
    path.write_bytes(bytes(len(data) - 1))
    assert fingerprint(path) != before


def test_a_small_file_is_fingerprinted_whole(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(bytes(1000))
    before = fingerprint(path)
    path.write_bytes(bytes(500) + b"\1" + bytes(499))
    assert fingerprint(path) != before
