"""The main job as a user types it: build, check, info, preview, and the same from Python."""

import json
import struct

import numpy as np
import pytest
from e2e.meshes import sphere, write_ply
from e2e.program import gstream, succeed

import gstream as api

RESOLUTION = 96
SMALL_CELLS = ("--block", 16, "--cell", 16, "--chunk", 200)  # many units in every stage


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a sphere, built in this process' way and reported."""
    made = tmp_path_factory.mktemp("job")
    write_ply(made / "sphere.ply", *sphere())
    arguments = ("sphere.ply", "-o", "sphere.gsb", "--resolution", RESOLUTION, *SMALL_CELLS)
    succeed(made, "build", *arguments, "--workers", 0, "--units", "m", "--report", "report.json")
    return made


def test_a_build_leaves_its_output_and_its_report_alone(folder):
    assert {"report.json", "sphere.gsb", "sphere.ply"} <= {p.name for p in folder.iterdir()}
    assert not [p.name for p in folder.iterdir() if p.name.startswith("gstream-")]
    assert not list(folder.glob("*.wip"))


def test_check_accepts_what_build_wrote(folder):
    assert "sphere.gsb: block file: valid" in succeed(folder, "check", "sphere.gsb")
    assert json.loads(succeed(folder, "check", "sphere.gsb", "--json"))["ok"] is True
    assert "valid" in succeed(folder, "check", "sphere.gsb", "--quick")


def test_the_ledger_adds_up_in_file_and_report(folder):
    held = json.loads(succeed(folder, "info", "sphere.gsb", "--json"))
    ledger = held["ledger"]
    fates = ("non_finite", "outside", "assigned", "unassigned")
    assert ledger["triangles"] == sum(ledger[fate] for fate in fates) == 4 * 60 * 60
    assert ledger["voxels"] == [level["voxels"] for level in held["levels"]]
    report = json.loads((folder / "report.json").read_text())
    assert report["file"] == {**held, "path": str(folder / "sphere.gsb")}
    assert report["output_bytes"] == held["bytes"] == (folder / "sphere.gsb").stat().st_size
    assert report["peak_memory"] > 0
    assert held["metadata"]["units"] == "m"


def test_the_voxels_lie_on_the_sphere(folder):
    with api.open(folder / "sphere.gsb") as scene:
        matrix = np.array(scene.header.matrix).reshape(3, 4)
        voxels = scene.region((-2, -2, -2), (2, 2, 2), columns=("normal",))
        sizes = [sum(block.count for block in scene.blocks(level)) for level in range(scene.levels)]
    centres = (voxels.positions + 0.5) @ matrix[:, :3].T + matrix[:, 3]
    distance = np.abs(np.linalg.norm(centres, axis=1) - 1)
    assert distance.max() < 1.5 * matrix[0, 0]
    assert len(centres) == sizes[0]
    assert sizes == sorted(sizes, reverse=True)


def test_preview_writes_a_picture_of_the_size_asked_for(folder):
    said = succeed(folder, "preview", "sphere.gsb", "-o", "sphere.png", "--size", "96x64")
    picture = (folder / "sphere.png").read_bytes()
    assert picture[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", picture[16:24]) == (96, 64)
    assert said.startswith("sphere.png: 96x64, level 0")


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_any_number_of_workers_writes_the_same_bytes(folder, workers):
    output = f"workers{workers}.gsb"
    arguments = ("sphere.ply", "-o", output, "--resolution", RESOLUTION, *SMALL_CELLS)
    succeed(folder, "build", *arguments, "--workers", workers, "--units", "m", "--memory", "4GiB")
    assert (folder / output).read_bytes() == (folder / "sphere.gsb").read_bytes()


def test_ingest_then_voxelize_writes_the_bytes_of_build(folder):
    succeed(folder, "ingest", "sphere.ply", "-o", "sphere.gst", "--units", "m", "--chunk", 1000)
    assert "valid" in succeed(folder, "check", "sphere.gst")
    held = json.loads(succeed(folder, "info", "sphere.gst", "--json"))
    assert held["triangles"] == 4 * 60 * 60
    arguments = ("sphere.gst", "-o", "two.gsb", "--resolution", RESOLUTION, "--block", 16)
    succeed(folder, "voxelize", *arguments, "--cell", 32, "--workers", 0)
    assert (folder / "two.gsb").read_bytes() == (folder / "sphere.gsb").read_bytes()


def test_a_compact_stream_is_the_smallest_and_builds_the_same_voxels(folder):
    ways = {
        "fast": (),
        "spatial": ("--order", "spatial", "--lz4", "hc"),
        "long": ("--order", "smallest", "--lz4", "hc", "--workers", 0),
        "short": ("--compact", "--workers", 2),
    }
    streams = {}
    for name, options in ways.items():
        succeed(folder, "ingest", "sphere.ply", "-o", f"{name}.gst", *options)
        assert "valid" in succeed(folder, "check", f"{name}.gst")
        streams[name] = (folder / f"{name}.gst").read_bytes()
    assert streams["short"] == streams["long"]
    assert len(streams["short"]) == min(map(len, streams.values()))
    build = ("build", "sphere.ply", "-o", "compact.gsb", "--resolution", RESOLUTION, *SMALL_CELLS)
    succeed(folder, *build, "--units", "m", "--compact")
    assert (folder / "compact.gsb").read_bytes() == (folder / "sphere.gsb").read_bytes()


def test_python_builds_the_same_bytes_and_checks_them(folder):
    report = api.build(
        folder / "sphere.ply",
        folder / "python.gsb",
        resolution=RESOLUTION,
        block=16,
        ingest={"metadata": {"units": "m"}},
        workers=0,
    )
    assert [stage.stage[2:] for stage in report.stages][-1] == "pack"
    assert (folder / "python.gsb").read_bytes() == (folder / "sphere.gsb").read_bytes()
    assert api.check(folder / "python.gsb").ok


def test_an_existing_output_is_replaced_only_when_forced(folder):
    arguments = ("build", "sphere.ply", "-o", "again.gsb", "--resolution", 16, "--workers", 0)
    succeed(folder, *arguments, "--quiet")
    before = (folder / "again.gsb").read_bytes()
    assert gstream(folder, *arguments).returncode == 2
    assert (folder / "again.gsb").read_bytes() == before
    done = gstream(folder, *arguments, "--force", "--quiet", "--no-lod")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (folder / "again.gsb").read_bytes() != before


def test_a_flipped_bit_is_found_by_check(folder):
    data = bytearray((folder / "sphere.gsb").read_bytes())
    data[len(data) * 3 // 4] ^= 1
    (folder / "flipped.gsb").write_bytes(data)
    done = gstream(folder, "check", "flipped.gsb")
    assert done.returncode == 4
    assert "INVALID" in done.stdout
    assert done.stderr.startswith("gstream: flipped.gsb: ")
    assert done.stderr.count("\n") == 1


def test_info_into_a_closed_pipe_is_no_error(folder):
    import subprocess

    from e2e.program import PROGRAM

    command = f"{PROGRAM} info sphere.gsb --json | true"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], cwd=folder, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
