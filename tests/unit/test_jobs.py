"""The folder of a stopped job: what it tells, how it is resumed, how it is removed."""

import errno
import json
import os
import re
import struct
from pathlib import Path
from types import SimpleNamespace

import pytest

from gstream.errors import RefusedError, StoppedError, UsageError
from gstream.job import IngestSettings, VoxelizeSettings
from gstream.run import commands, jobs, publish
from gstream.run.budget import DiskNeed
from gstream.run.commands import Request, RunOptions
from gstream.run.jobs import clean, status
from gstream.run.local import locked_folder
from gstream.run.progress import Event
from gstream.stages import ingest

TRIANGLE = struct.pack("<12fH", *[0.0] * 3, *[0.0] * 3, 1, 0, 0, 0, 1, 0, 0)
SETTINGS = {"chunk_triangles": 2, "metadata": {"up": "z"}, "bounds": (-1.0, -1, -1, 2, 2, 2)}
UNITS = 3  # of 16 chunks each


def write_stl(path: Path, triangles: int = 16 * 2 * (UNITS - 1) + 1) -> Path:
    path.write_bytes(bytes(80) + struct.pack("<I", triangles) + TRIANGLE * triangles)
    return path


def request(folder: Path, **options: object) -> Request:
    settings = IngestSettings((str(folder / "a.stl"),), **SETTINGS)  # type: ignore[arg-type]
    running = RunOptions(workers=0, **options)  # type: ignore[arg-type]
    return commands.ingest(settings, str(folder / "a.gst"), running)


@pytest.fixture
def no_tmpdir(monkeypatch):
    monkeypatch.delenv("TMPDIR", raising=False)


@pytest.fixture
def stopped(tmp_path, monkeypatch, no_tmpdir):
    """The folder of a job that was stopped before its last unit."""
    write_stl(tmp_path / "a.stl")
    work, left = ingest.work, UNITS - 1

    def stop_at_the_last(job, unit):
        nonlocal left
        if not left:
            raise StoppedError("the disk is full", "free some space")
        left -= 1
        work(job, unit)

    with monkeypatch.context() as patched:
        patched.setattr(ingest, "work", stop_at_the_last)
        with pytest.raises(StoppedError):
            request(tmp_path).run()
    return request(tmp_path).folder


@pytest.fixture
def whole(tmp_path_factory, no_tmpdir):
    """The bytes that an undisturbed run makes."""
    folder = tmp_path_factory.mktemp("whole")
    write_stl(folder / "a.stl")
    request(folder).run()
    return (folder / "a.gst").read_bytes()


def test_a_stopped_job_tells_its_units_counts_and_bytes(stopped, tmp_path):
    found = status(stopped)
    assert [(s.stage, s.done, s.units) for s in found.stages] == [
        ("1-spill", 1, 1),
        ("2-ingest", 2, 3),
    ]
    assert found.stages[1].counts["stored"] == 64
    assert found.job["output"] == str(tmp_path / "a.gst")
    assert not found.running
    files = [path for path in stopped.rglob("*") if path.is_file()]
    assert found.scratch_bytes == sum(path.stat().st_size for path in files)


def test_the_age_of_a_job_is_that_of_its_last_unit(stopped):
    for path in stopped.rglob("*.done"):
        os.utime(path, (0, 0))
    last = stopped / "2-ingest/00000-0000001.done"
    os.utime(last, (last.stat().st_ctime - 1000,) * 2)
    assert 1000 <= status(stopped).last_unit_seconds < 1100


def test_a_unit_whose_file_is_cut_is_not_told_as_done(stopped):
    (stopped / "2-ingest/00000-0000000.part").write_bytes(b"")
    assert status(stopped).stages[1].done == 1


def test_a_job_that_a_process_holds_is_told_as_running_and_not_removed(stopped):
    with locked_folder(str(stopped)):
        assert status(stopped).running
        with pytest.raises(UsageError, match="running already in another process"):
            clean(stopped)
    assert status(stopped).stages


def test_a_resumed_job_does_what_is_left_and_ends_in_the_same_bytes(
    stopped, tmp_path, whole, monkeypatch
):
    monkeypatch.chdir("/")
    report = commands.resume(stopped, {}).run()
    assert [(stage.units, stage.resumed) for stage in report.stages] == [(1, 1), (3, 2)]
    assert (tmp_path / "a.gst").read_bytes() == whole
    assert sorted(os.listdir(tmp_path)) == ["a.gst", "a.stl"]


def test_a_job_of_relative_paths_is_resumed_from_another_folder(tmp_path, monkeypatch, whole):
    monkeypatch.chdir(tmp_path)
    write_stl(Path("a.stl"))
    with monkeypatch.context() as patched:
        patched.setattr(ingest, "finish", stop)
        with pytest.raises(StoppedError):
            request(Path()).run()
    monkeypatch.chdir("/")
    assert commands.resume(next(tmp_path.glob("gstream-*")), {}).run().stages[1].resumed == 3
    assert (tmp_path / "a.gst").read_bytes() == whole


def stop(*_: object) -> None:
    raise StoppedError("the disk is full", "free some space")


@pytest.mark.parametrize("how", ["rerun", "resume"])
def test_a_stream_that_was_complete_when_its_job_stopped_is_not_written_again(
    tmp_path, monkeypatch, no_tmpdir, how
):
    def fail(folder: Path) -> None:
        if folder == tmp_path:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    write_stl(tmp_path / "a.stl")
    with monkeypatch.context() as patched:
        patched.setattr(publish, "sync_folder", fail)
        with pytest.raises(StoppedError, match="Input/output error"):
            request(tmp_path).run()
    made = (tmp_path / "a.gst").stat().st_ino
    again = request(tmp_path) if how == "rerun" else commands.resume(request(tmp_path).folder, {})
    assert again.run().stages == ()
    assert (tmp_path / "a.gst").stat().st_ino == made
    assert sorted(os.listdir(tmp_path)) == ["a.gst", "a.stl"]


def test_a_resumed_job_keeps_its_settings_and_takes_other_options(stopped, tmp_path):
    asked, found = request(tmp_path), commands.resume(stopped, {"memory": 3 << 30, "workers": 2})
    assert found.ingest == asked.ingest
    assert found.identity() == asked.identity()
    assert (found.options.memory, found.workers) == (3 << 30, 2)
    assert commands.resume(stopped, {}).workers == 0


def test_an_output_that_has_appeared_meanwhile_is_replaced_only_by_force(stopped, tmp_path, whole):
    (tmp_path / "a.gst").write_bytes(b"another program's")
    with pytest.raises(UsageError, match="exists already; add --force"):
        commands.resume(stopped, {})
    commands.resume(stopped, {"force": True}).run()
    assert (tmp_path / "a.gst").read_bytes() == whole


def test_voxelize_settings_survive_the_record(tmp_path, monkeypatch, no_tmpdir):
    write_stl(tmp_path / "a.stl")
    chosen = {"columns": ("colour",), "required": ("colour",), "lod": False}
    settings = VoxelizeSettings(voxel_size=0.1, sep="conservative", snap_bits=9, **chosen)
    source = IngestSettings((str(tmp_path / "a.stl"),))
    asked = commands.build(source, settings, str(tmp_path / "a.gsb"), RunOptions(workers=0))
    monkeypatch.setattr(ingest, "finish", stop)
    with pytest.raises(StoppedError):
        asked.run()
    assert commands.resume(asked.folder, {}).voxelize == settings


@pytest.mark.parametrize("how", ["rerun", "resume"])
def test_a_job_whose_input_has_changed_is_refused_with_both_fingerprints(stopped, tmp_path, how):
    before = status(stopped).job["inputs"][0][1]
    write_stl(tmp_path / "a.stl", 7)
    with pytest.raises(UsageError) as refused:
        (request(tmp_path) if how == "rerun" else commands.resume(stopped, {})).run()
    now = request(tmp_path).identity().inputs[0][1]
    assert f"a.stl was {before}, is {now}" in str(refused.value)
    assert status(stopped).stages[1].done == 2
    if how == "rerun":
        assert request(tmp_path, restart=True).run().stages[1].resumed == 0


OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n"
RED, BLUE = "newmtl m\nKd 1 0 0\n", "newmtl m\nKd 0 0 1\n"


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        (RED, BLUE, r"a\.mtl was 18-[0-9a-f]{32}, is 18-[0-9a-f]{32}; put that back"),
        (None, RED, r"a\.mtl was no file, is 18-"),
        (RED, None, r"a\.mtl was 18-[0-9a-f]{32}, is no file;"),
    ],
)
def test_a_job_whose_input_s_colours_have_changed_is_refused(
    tmp_path, monkeypatch, no_tmpdir, before, now, said
):
    def write(text: str | None) -> None:
        (tmp_path / "a.mtl").unlink(missing_ok=True)
        if text is not None:
            (tmp_path / "a.mtl").write_text(text)

    (tmp_path / "a.obj").write_text(OBJ)
    source, output = IngestSettings((str(tmp_path / "a.obj"),)), str(tmp_path / "a.gst")
    write(before)
    with monkeypatch.context() as patched:
        patched.setattr(ingest, "finish", stop)
        with pytest.raises(StoppedError):
            commands.ingest(source, output, RunOptions(workers=0)).run()
    write(now)
    again = commands.ingest(source, output, RunOptions(workers=0))
    with pytest.raises(UsageError, match=said):
        again.run()
    write(before)
    assert again.run().stages[0].resumed == 1


def test_a_paranoid_resume_repeats_a_unit_whose_bytes_were_damaged(stopped, tmp_path, whole):
    part = stopped / "2-ingest/00000-0000000.part"
    data = bytearray(part.read_bytes())
    data[-1] ^= 1
    part.write_bytes(data)
    report = commands.resume(stopped, {"paranoid": True}).run()
    assert report.stages[1].resumed == 1
    assert (tmp_path / "a.gst").read_bytes() == whole


def test_a_job_of_another_version_is_not_resumed(stopped):
    record = json.loads((stopped / "job.json").read_text())
    record["job"]["version"] = "0.0.9"
    (stopped / "job.json").write_text(json.dumps(record))
    with pytest.raises(UsageError, match=r"begun by gstream 0\.0\.9, and this is .*gstream clean"):
        commands.resume(stopped, {})


def test_a_job_that_was_moved_is_not_resumed(stopped):
    moved = stopped.rename(stopped.with_name("moved"))
    with pytest.raises(UsageError, match=f"was moved.*{stopped}; move it back"):
        commands.resume(moved, {})


def test_a_job_whose_input_is_gone_is_not_resumed(stopped, tmp_path):
    (tmp_path / "a.stl").unlink()
    with pytest.raises(UsageError, match=r"a\.stl: no such file"):
        commands.resume(stopped, {})


def need_of(monkeypatch, scratch: int, output: int, free: int) -> None:
    monkeypatch.setattr(commands, "disk_of_ingest", lambda _: DiskNeed(scratch, output))
    monkeypatch.setattr(commands.shutil, "disk_usage", lambda _: SimpleNamespace(free=free))


def test_what_a_stopped_job_holds_is_not_needed_again(stopped, tmp_path, monkeypatch):
    need_of(monkeypatch, 10**9, 0, 10**9 - jobs.size_of(stopped))
    request(tmp_path).run()
    with pytest.raises(RefusedError, match="needs about 954 MiB, and 953 MiB are free"):
        request(tmp_path, force=True).run()


def test_scratch_and_output_on_one_volume_need_it_together(tmp_path, monkeypatch, no_tmpdir):
    write_stl(tmp_path / "a.stl")
    need_of(monkeypatch, 30 << 20, 30 << 20, 50 << 20)
    with pytest.raises(RefusedError, match="with the output needs about 60 MiB, and 50 MiB are"):
        request(tmp_path).run()
    stat = os.stat

    def of_other_volumes(path: object, **more: object) -> object:
        found = stat(path, **more)  # type: ignore[call-overload]
        return SimpleNamespace(st_dev=7) if str(path) == str(tmp_path / "tmp") else found

    (tmp_path / "tmp").mkdir()
    asked = request(tmp_path, tmp=str(tmp_path / "tmp"))
    with monkeypatch.context() as patched:
        patched.setattr(commands.os, "stat", of_other_volumes)
        asked._check_disk(asked.disk(), 0)


@pytest.mark.parametrize("use", [status, clean, lambda path: commands.resume(path, {})])
def test_a_folder_of_somebody_else_is_left_alone(tmp_path, use):
    (tmp_path / "gstream-0123456789abcdef").mkdir()
    (tmp_path / "gstream-0123456789abcdef/job.json").write_text('{"name": "my job"}')
    with pytest.raises(UsageError, match="is not the folder of a job"):
        use(tmp_path / "gstream-0123456789abcdef")
    with pytest.raises(UsageError, match="is not there; a finished job leaves no folder"):
        use(tmp_path / "gstream-0123456789abcdee")
    assert (tmp_path / "gstream-0123456789abcdef/job.json").exists()


def test_a_folder_that_cannot_be_read_is_left_alone(tmp_path):
    (tmp_path / "job.json").mkdir()
    for use in (status, clean):
        with pytest.raises(UsageError, match=r"job\.json: cannot be read: Is a directory"):
            use(tmp_path)


def test_a_removed_job_leaves_its_inputs_and_nothing_else(stopped, tmp_path):
    (tmp_path / "a.gst.wip").write_bytes(bytes(1000))
    held = status(stopped).scratch_bytes
    assert clean(stopped) == held + 1000
    assert os.listdir(tmp_path) == ["a.stl"]


def test_what_a_killed_removal_left_is_removed(stopped):
    half = stopped.rename(stopped.with_name(f"{stopped.name}.removed"))
    (half / "job.json").unlink()
    assert clean(half) > 0
    assert not half.exists()


def test_what_a_run_killed_at_its_very_start_left_is_removed(tmp_path):
    folder = tmp_path / "gstream-0123456789abcdef"
    folder.mkdir()
    (folder / "lock").touch()
    (folder / "job.json.wip").write_bytes(b"{")
    assert clean(folder) == 1
    assert os.listdir(tmp_path) == []


def test_an_output_whose_scratch_was_left_is_told_with_the_command_that_drops_it(stopped, tmp_path):
    (tmp_path / "a.gst").touch()
    with pytest.raises(UsageError, match=f"exists already.*gstream clean {stopped}"):
        request(tmp_path)
    clean(stopped)
    with pytest.raises(UsageError, match=r"exists already; add --force to replace it$"):
        request(tmp_path)


def test_a_tmpdir_that_is_not_there_is_named(tmp_path, monkeypatch):
    write_stl(tmp_path / "a.stl")
    monkeypatch.setenv("TMPDIR", str(tmp_path / "no"))
    with pytest.raises(UsageError, match=r"no: \$TMPDIR does not exist; create it first"):
        request(tmp_path)


def test_a_run_tells_start_and_end_and_a_stopped_one_how_to_go_on(stopped, tmp_path, monkeypatch):
    told: list[Event] = []
    with monkeypatch.context() as patched:
        patched.setattr(ingest, "finish", stop)
        with pytest.raises(StoppedError):
            request(tmp_path).run(told.append)
    names = [event.NAME for event in told if event.NAME != "memory"]
    first = ["note", "note", "start", "resumed", "stage_begin", "stage_end"]
    ready = ["kernels", "kernels"]  # loading, then loaded
    assert names == [*first, "resumed", "stage_begin", *ready, "unit_done", "stopped"]
    assert re.fullmatch("disk: about [0-9.]+ MiB of scratch, [0-9.]+ MiB of output", told[0].said)
    assert f"gstream resume {stopped}" in told[-1].said
    told.clear()
    request(tmp_path).run(told.append)
    assert told[-1].NAME == "end"
    assert told[-1].output_bytes == (tmp_path / "a.gst").stat().st_size


@pytest.mark.parametrize("given", [True, False])
def test_scratch_goes_to_tmp_before_tmpdir_before_the_output_s_folder(
    tmp_path, monkeypatch, no_tmpdir, given
):
    write_stl(tmp_path / "a.stl")
    assert request(tmp_path).folder.parent == tmp_path
    for name in ("env", "option"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "env"))
    tmp = str(tmp_path / "option") if given else None
    wanted = tmp_path / ("option" if given else "env")
    assert request(tmp_path, tmp=tmp).folder.parent == wanted
