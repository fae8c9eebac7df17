"""Each operation of a small job on its disk fails in turn: one line, status 3, nothing lost."""

import errno
import json
import os
import re
import subprocess
import sys

import pytest
from faults.disk import Told

ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EACCES)
WRITING = ("open", "write", "fsync", "rename")


def failing(number: int, error: int) -> Told:
    """A disk whose operation `number` fails; a write does not know the name of its file."""

    def told(at: int, operation: str, path: str) -> None:
        if at == number:
            names = () if operation in ("write", "fsync") else (path,)
            raise OSError(error, os.strerror(error), *names)

    return told


def try_all(tiny, numbers, errors_of) -> None:
    """Let each of these operations fail with each of its errors, and run again."""
    published = tiny.log.index(("rename", str(tiny.output)))
    for number in numbers:
        for error in errors_of(number):
            trial = f"{number}: {tiny.log[number]} fails with {errno.errorcode[error]}"
            tiny.empty()
            code, said = tiny.build_on(failing(number, error))
            assert code == 3, f"{trial}: {said}"
            assert re.fullmatch(rf"gstream: .*{os.strerror(error)} in .*\n", said), trial
            assert "run the same command again to resume" in said, trial
            assert tiny.held() == (None if number <= published else tiny.whole), trial
            assert tiny.build() == (0, ""), trial
            assert tiny.held() == tiny.whole, trial
            assert os.listdir(tiny.place) == [tiny.output.name], trial


@pytest.mark.parametrize("operation", WRITING)
def test_any_failing_operation_stops_the_job_which_resumes_to_the_same_bytes(tiny, operation):
    try_all(tiny, tiny.numbers(operation), lambda number: [ERRORS[number % len(ERRORS)]])


@pytest.mark.long
@pytest.mark.parametrize("error", ERRORS, ids=lambda error: errno.errorcode[error])
def test_any_failing_operation_with_any_error_stops_the_job(tiny, error):
    try_all(tiny, tiny.numbers(*WRITING), lambda _: [error])


@pytest.mark.long
def test_any_failing_read_stops_the_job_which_resumes_to_the_same_bytes(tiny):
    try_all(tiny, tiny.numbers("read"), lambda _: [errno.EIO])


def test_a_job_that_is_stopped_when_its_output_is_there_is_done_without_another_unit(tiny):
    published = tiny.log.index(("rename", str(tiny.output)))
    report = tiny.place / "report"
    for number in [n for n in tiny.numbers(*WRITING) if n > published]:
        tiny.empty()
        assert tiny.build_on(failing(number, errno.EIO))[0] == 3
        made = tiny.output.stat().st_ino
        assert tiny.build("--report", report) == (0, "")
        assert json.loads(report.read_text())["stages"] == []
        assert tiny.output.stat().st_ino == made
        assert tiny.held() == tiny.whole
        assert tiny.build()[0] == 2, "it is an output like any other now"


@pytest.mark.parametrize(
    ("meanwhile", "more", "said"),
    [
        ("the output is another file", (), "exists already; add --force"),
        ("", ("--restart",), "exists already; add --force"),
        ("", ("--sep", "26"), "sep 6, now 26"),
    ],
)
def test_an_output_that_is_not_what_the_stopped_job_made_is_kept(tiny, meanwhile, more, said):
    published = tiny.log.index(("rename", str(tiny.output)))
    tiny.empty()
    assert tiny.build_on(failing(published + 1, errno.EIO))[0] == 3
    if meanwhile:
        other = tiny.place / "other"
        other.write_bytes(tiny.whole)
        other.replace(tiny.output)
    made = tiny.output.stat().st_ino
    code, line = tiny.build(*more)
    assert (code, said in line) == (2, True), line
    assert tiny.output.stat().st_ino == made


def test_a_job_whose_folder_cannot_be_removed_has_ended_well(tiny):
    gone = max(n for n, (_, path) in enumerate(tiny.log) if path.endswith(".removed"))
    for number in range(tiny.end, gone + 1):
        tiny.empty()
        assert tiny.build_on(failing(number, errno.EIO)) == (0, ""), tiny.log[number]
        assert tiny.held() == tiny.whole


def test_a_failing_disk_leaves_the_old_output_whole(tiny):
    log = []

    def build(told: Told) -> int:
        tiny.empty()
        tiny.output.write_bytes(b"old")
        return tiny.build_on(told, "--force")[0]

    assert build(lambda _, *operation: log.append(operation)) == 0
    published = log.index(("rename", str(tiny.output)))
    for number in range(published - 20, published + 6):
        if log[number][0] in WRITING:
            assert build(failing(number, errno.ENOSPC)) == 3
            assert tiny.held() == (b"old" if number <= published else tiny.whole)
            assert tiny.build("--force") == (0, "")
            assert tiny.held() == tiny.whole


def test_a_disk_that_takes_half_of_every_write_gives_the_same_bytes(tiny):
    tiny.empty()
    assert tiny.build_on(lambda *_: None, half=True) == (0, "")
    assert tiny.held() == tiny.whole


@pytest.mark.parametrize("old", [None, b"old"])
def test_at_every_moment_of_a_build_the_output_is_the_old_one_or_the_new(tiny, old):
    tiny.empty()
    if old is not None:
        tiny.output.write_bytes(old)
    seen = []
    assert tiny.build_on(lambda *_: seen.append(tiny.held()), "--force") == (0, "")
    assert set(seen) == {old, tiny.whole}


FULL = """
import sys
from pathlib import Path
from gstream.readers import open_mesh
try:
    open_mesh(Path("a.obj"), lambda label: Path(sys.argv[1], label))
except OSError as error:
    print(error.errno, Path(sys.argv[1], "normals").exists())
"""


def test_a_disk_without_room_for_mapped_normals_is_an_error_and_no_signal(tmp_path):
    lines = ["v 0 1 2"] * 99_999 + ["vn 0 0 1"]  # all but normals takes 3.2 MB, they take 1.2
    lines += [f"f {i}//1 {i + 1}//1 {i + 2}//1" for i in range(1, 99_999, 3)]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    (tmp_path / "disk").mkdir()
    mount = "mount -t tmpfs -o size=4m none disk"
    run = ["unshare", "-Urm", "sh", "-c", f'{mount} && "$0" -c "$1" disk', sys.executable, FULL]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=False)
    if "not permitted" in done.stderr or "denied" in done.stderr:
        pytest.skip("this user may not mount a tmpfs")
    assert done.stdout.split() == [str(errno.ENOSPC), "True"], done.stderr
