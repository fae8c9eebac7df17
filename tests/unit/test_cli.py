"""The command line without a job: options, one-line errors, exit codes, and what is imported."""

import json
import os
import subprocess
import sys

import click
import pytest

import gstream
from gstream.errors import (
    CorruptFileError,
    InputError,
    RefusedError,
    StoppedError,
    UnsupportedError,
    UsageError,
)
from gstream.run.progress import (
    Event,
    Kernels,
    Memory,
    Note,
    StageBegins,
    StageEnds,
    UnitDone,
)
from gstream.run.worker import UnitError
from gstream_cli import main, options
from gstream_cli.pace import clock
from gstream_cli.progress import Bars, Blocks, Lines


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    status = main.status([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return status, said.out, said.err


def test_version_is_the_package_s(capsys):
    assert call(capsys, "--version") == (0, f"gstream {gstream.__version__}\n", "")


@pytest.mark.parametrize("command", main.COMMANDS)
def test_every_command_s_help_has_an_example(capsys, command):
    status, out, err = call(capsys, command, "--help")
    assert (status, err) == (0, "")
    assert f"gstream {command} " in out.split("Options:")[0].split("\n", 1)[1]


IMPORTS = """
import sys
from gstream_cli import main
status = main.status({arguments!r})
heavy = sorted({{"numba", "zarr", "rich", "dask"}} & set(sys.modules))
print(status, heavy)
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["build", "--help"],
        ["info", "--help"],
        ["info", "missing.gsb"],
        ["check", "missing.gsb", "-q"],
    ],
    ids=" ".join,
)
def test_help_info_and_check_import_nothing_heavy(tmp_path, arguments):
    script = IMPORTS.format(arguments=arguments)
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] in ("0 []", "2 []")


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (UsageError("a", "b"), 2),
        (StoppedError("a", "b"), 3),
        (InputError("a.ply", "line 3", "is odd", "mend it"), 4),
        (CorruptFileError("GSB-0101", "a.gsb", 7, "odd"), 4),
        (RefusedError("a", "b"), 5),
        (UnsupportedError("a.gsb", "version 9", "update"), 6),
    ],
)
def test_an_error_of_the_library_is_its_one_line_and_its_exit_code(
    capsys, monkeypatch, error, status
):
    monkeypatch.setattr(main.main, "main", raises(error))
    assert call(capsys) == (status, "", f"gstream: {error}\n")


def test_an_error_of_ours_asks_for_a_report_in_one_line(capsys, monkeypatch):
    monkeypatch.delenv("GSTREAM_DEBUG", raising=False)
    monkeypatch.setattr(main.main, "main", raises(ZeroDivisionError("by\nnought")))
    status, out, err = call(capsys)
    assert (status, out) == (1, "")
    assert err.startswith("gstream: ZeroDivisionError: by nought; an error of ours: please report")
    assert err.count("\n") == 1


def test_debug_shows_the_traceback_of_a_worker_too(capsys, monkeypatch):
    monkeypatch.setenv("GSTREAM_DEBUG", "1")
    monkeypatch.setattr(main.main, "main", raises(UnitError("unit u1", "odd", "in the worker\n")))
    err = call(capsys)[2]
    assert "Traceback" in err
    assert "in the worker" in err


def raises(error: Exception):
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


MESH = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["frobnicate"], "No such command 'frobnicate'; see 'gstream --help'"),
        (["build", "-o", "x.gsb"], "Missing argument 'INPUT...'; see 'gstream build --help'"),
        (["build", "a.ply", "-o", "x.gsb"], "the voxels have no size; give either"),
        (["build", "a.ply", "-o", "x.gsb", "--resolution", "0"], "--resolution 0 is out of range"),
        (["build", "a.ply", "-o", "x.gsb", "--resolution", "3000000000"], "--resolution 3000000"),
        (["build", "a.ply", "-o", "x.gsb", "--voxel-size", "-1"], "--voxel-size -1.0 is out of"),
        (["build", "a.ply", "-o", "x.gsb", "--voxel-size", "nan"], "--voxel-size nan is out of"),
        (
            ["build", "a.ply", "-o", "x.gsb", "--voxel-size", "1", "--resolution", "4"],
            "the voxels have two sizes; give either --resolution or --voxel-size",
        ),
        (
            ["build", "a.ply", "-o", "x.gsb", "--resolution", "65536", "--snap-bits", "11"],
            "coordinates span 65536 voxels, and their bits and these are at most 26 together; "
            "give 1 to 10, or fewer voxels",
        ),
        (["build", "a.ply", "-o", "x.gsb", "--resolution", "9", "--block", "48"], "--block 48 is"),
        (["build", "a.ply", "-o", "x.gsb", "--resolution", "9", "--cell", "32"], "--cell 32 is"),
        (["build", "a.ply", "-o", "x.gsb", "--resolution", "9", "--memory", "lots"], "Invalid val"),
        (["build", "no.ply", "-o", "x.gsb", "--resolution", "9"], "no.ply: no such file; check"),
        (["build", ".", "-o", "x.gsb", "--resolution", "9"], ".: is a folder; name the file in it"),
        (["build", "a.ply", "-o", "no/x.gsb", "--resolution", "9"], "the output's folder does not"),
        (["build", "a.ply", "-o", "a.ply", "--resolution", "9"], "a.ply: is an input as well as"),
        (["build", "a.ply", "-o", "old", "--resolution", "9"], "old: exists already; add --force"),
        (["build", "a.ply", "-o", "x", "--resolution", "9", "--tmp", "no"], "no: the folder for"),
        (
            ["ingest", "a.ply", "-o", "x.gst", "--report", "no/r"],
            "no: the report's folder does not exist; create it first",
        ),
        (
            ["ingest", "a.ply", "-o", "x.gst", "--log", "no/l"],
            "no/l: cannot be written: No such file or directory; give another file for --log",
        ),
        (["status", "no"], "no: is not there; a finished job leaves no folder; check the name"),
        (["clean", "."], "is not the folder of a job; name the folder gstream-… that a stopped"),
        (["resume", "old"], "old: is not the folder of a job"),
        (["ingest", "a.ply", "-o", "x.gst", "--bounds", "1,2"], "is not a box; write it like"),
        (
            ["ingest", "a.ply", "-o", "x.gst", "--compact", "--order", "file"],
            "--compact chooses the order and so does --order file; give one of them",
        ),
        (["ingest", "a.ply", "-o", "x.gst", "--up", "w"], "--up w is no axis; give x, y or z"),
        (["info", "no.gsb"], "no.gsb: cannot be read: No such file or directory; check its name"),
        (["preview", "old", "-o", "a.png", "--size", "0x9"], "is not a picture size; write it"),
    ],
    ids=lambda value: " ".join(value[:5]) if isinstance(value, list) else "",
)
def test_a_usage_error_is_one_line_exits_with_2_and_writes_nothing(
    capsys, monkeypatch, tmp_path, arguments, said
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.ply").write_text(MESH)
    (tmp_path / "old").write_text("old")
    status, out, err = call(capsys, *arguments)
    assert (status, out) == (2, "")
    assert err.startswith("gstream: ")
    assert said in err
    assert err.count("\n") == 1
    assert sorted(os.listdir(tmp_path)) == ["a.ply", "old"]
    assert (tmp_path / "old").read_text() == "old"


def test_too_little_memory_exits_with_5_and_the_least_that_would_do(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.ply").write_text(MESH)
    arguments = ["build", "a.ply", "-o", "x.gsb", "--resolution", 64, "--memory", "10MiB"]
    status, _, err = call(capsys, *arguments)
    assert status == 5
    assert "--memory 10MiB is too little" in err
    assert os.listdir(tmp_path) == ["a.ply"]


def test_a_dry_run_prints_the_plan_and_writes_nothing(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.ply").write_text(MESH)
    arguments = ["build", "a.ply", "-o", "x.gsb", "--resolution", 64, "--workers", 2, "--dry-run"]
    status, out, err = call(capsys, *arguments)
    assert (status, err) == (0, "")
    names = [line.split()[0] for line in out.splitlines()]
    assert names == ["input", "output", "stages", "memory", "scratch", "disk"]
    assert "2048.0 MiB: 2 workers" in out
    assert os.listdir(tmp_path) == ["a.ply"]


def test_a_file_of_another_kind_exits_with_4(capsys, tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(MESH)
    status, _, err = call(capsys, "info", path)
    assert status == 4
    assert "neither a block file nor a geometry stream" in err


@pytest.mark.parametrize(
    ("text", "size"),
    [("2GiB", 2 << 30), ("512MiB", 512 << 20), ("1.5G", 3 << 29), ("2GB", 2 * 10**9), ("7", 7)],
)
def test_sizes_are_read_as_written(text, size):
    assert options.Size().convert(text, None, None) == size


@pytest.mark.parametrize("text", ["", "2 apples", "-1GiB", "GiB", "1e3"])
def test_other_sizes_are_refused(text):
    with pytest.raises(click.BadParameter, match="write it like 512MiB or 2GiB"):
        options.Size().convert(text, None, None)


class Clock:
    """time.monotonic, by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock_by_hand(monkeypatch):
    hand = Clock()
    monkeypatch.setattr("gstream_cli.progress.time", hand)
    monkeypatch.setattr("gstream_cli.pace.time", hand)
    return hand


def test_lines_are_two_seconds_apart_and_held_notes_come_with_the_first(capsys, clock_by_hand):
    lines = Lines(sys.stderr)
    lines(Note("working in x"))
    lines(StageBegins("voxelize", 4, 8.0))
    for _ in range(4):
        clock_by_hand.now += 1.5
        lines(UnitDone("voxelize", 2.0))
    lines(StageEnds("voxelize", 6.0))
    assert capsys.readouterr().err.splitlines() == [
        "working in x",
        "voxelize: 2/4 units, 0.7/s, 0:03 left",
        "voxelize: 4/4 units, 0.7/s, 0:00 left",
    ]


def test_a_stage_that_compiles_says_so_and_not_that_its_units_take_long(capsys, clock_by_hand):
    lines = Lines(sys.stderr)
    lines(StageBegins("voxelize", 4, 8.0))
    for ready in (False, True):
        lines(Kernels("voxelize", ready))
        clock_by_hand.now += 12.0
        lines(Memory(0, 0))
    assert capsys.readouterr().err.splitlines() == [
        "voxelize: 0/4 units, compiling for 0:12, once after an installation",
        "voxelize: 0/4 units, none finished in 0:12",
    ]


def test_a_job_that_fails_at_once_says_only_its_error(capsys, clock_by_hand):
    with pytest.raises(InputError), Lines(sys.stderr) as lines:
        lines(Note("working in x"))
        lines(StageBegins("spill", 1, 1.0))
        raise InputError("a.ply", "", "is empty", "copy it again")
    assert capsys.readouterr().err == ""


def test_bars_count_units_and_reach_the_end(capsys):
    with Bars() as bars:
        bars(Note("working in [x]"))
        bars(StageBegins("voxelize", 2, 0.0))
        bars(UnitDone("voxelize", 0.0))
        bars(UnitDone("voxelize", 0.0))
        bars(StageEnds("voxelize", 1.0))
        bars(StageBegins("merge", 0, 0.0))
        bars(StageEnds("merge", 0.0))
    err = capsys.readouterr().err
    assert "working in [x]" in err
    assert "2/2 units" in err


def test_blocks_tell_all_of_many_calls_in_few(capsys, clock_by_hand):
    told = []

    class Told(Lines):
        def __call__(self, event: Event) -> None:
            if isinstance(event, UnitDone):
                told.append(event.units)

    blocks = Blocks(Told(sys.stderr), "check")
    for done in range(1, 1001):
        clock_by_hand.now += 0.001
        blocks(done, 1000)
    assert sum(told) == 1000
    assert len(told) < 20


def test_clock_spells_hours_only_when_there_are_any():
    assert [clock(0), clock(59.6), clock(3725)] == ["0:00", "1:00", "1:02:05"]


def test_check_stays_a_function_whoever_imports_the_module():
    import gstream.check
    from gstream.check import check_file

    assert gstream.check is not sys.modules["gstream.check"]
    assert callable(gstream.check)
    assert callable(check_file)


def test_metadata_keeps_only_what_was_given():
    values = {"units": "", "up": "Z", "crs": None}
    assert options.metadata(values) == {"units": "", "up": "z"}
    json.dumps(options.metadata(values))
