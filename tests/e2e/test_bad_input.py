"""What is wrong with an input or a path is one line, the documented exit code, and no output."""

import contextlib
import json
import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from e2e.meshes import Floats, Ints, sphere, write_ply
from e2e.program import PROGRAM, fail, gstream, succeed

HEAD = (
    "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
)
FACES = "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
LITTLE = "binary_little_endian"


def ascii_ply(vertices: str, faces: str) -> bytes:
    counts = len(vertices.splitlines()), len(faces.splitlines())
    head = HEAD.format("ascii", counts[0]) + FACES.format(counts[1])
    return (head + vertices + faces).encode()


def binary_ply(vertices: int, faces: int, body: bytes) -> bytes:
    return (HEAD.format(LITTLE, vertices) + FACES.format(faces)).encode() + body


QUIETLY = ("--workers", 0, "--quiet")  # progress on a slow machine is a line as well
CORNERS = "0 0 0\n1 0 0\n0 1 0\n"
LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 123456\n"
BAD = {
    "empty.ply": b"",
    "no-vertices.ply": ascii_ply("", ""),
    "no-faces.ply": ascii_ply(CORNERS, ""),
    "index.ply": ascii_ply(CORNERS, "3 0 1 7\n"),
    "negative.ply": ascii_ply(CORNERS, "3 0 1 -1\n"),
    "all-nan.ply": ascii_ply("nan 0 0\n1 0 0\n0 1 0\n", "3 0 1 2\n"),
    "all-inf.ply": ascii_ply("inf 0 0\n1 0 0\n0 1 0\n", "3 0 1 2\n"),
    "cut.ply": binary_ply(3, 1, bytes(36) + b"\3\0\0"),
    "cut-in-vertices.ply": binary_ply(1000, 1000, bytes(100)),
    "text-in-binary.ply": binary_ply(3, 1, CORNERS.encode() + b"3 0 1 2\n"),
    "huge.ply": binary_ply(2**60, 1, bytes(49)),
    "huge-ascii.ply": (HEAD.format("ascii", 2**60) + FACES.format(1) + CORNERS).encode(),
    "word.ply": ascii_ply("0 0 zero\n1 0 0\n0 1 0\n", "3 0 1 2\n"),
    "lfs.ply": LFS,
    "lfs.obj": LFS,
    "no-faces.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
    "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
    "cut.stl": bytes(80) + (2).to_bytes(4, "little") + bytes(50),
    "empty.stl": b"",
    "cut.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n",
    "cut.ply.gz": b"\x1f\x8b\x08\0\0\0\0\0\0\3" + b"\xab" * 20,
    "picture.ply": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "notes.txt": b"to do: buy milk\n",
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_mesh_is_refused_in_one_line_with_exit_4_and_leaves_nothing(tmp_path, name):
    (tmp_path / name).write_bytes(BAD[name])
    line = fail(tmp_path, 4, "build", name, "-o", "out.gsb", "--resolution", 16, *QUIETLY)
    assert name in line
    assert ";" in line  # what to do about it
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("reach", ["1e-306", "1.7e308"])
def test_a_scene_too_small_or_too_large_for_any_grid_ends_with_4_and_leaves_nothing(
    tmp_path, reach
):
    (tmp_path / "far.obj").write_text(f"v -{reach} 0 0\nv {reach} 0 0\nv 0 {reach} 0\nf 1 2 3\n")
    line = fail(tmp_path, 4, "build", "far.obj", "-o", "out.gsb", "--resolution", 16, *QUIETLY)
    assert "the scene's extent is beyond double precision; scale the scene" in line
    assert os.listdir(tmp_path) == ["far.obj"]


def test_non_finite_and_degenerate_triangles_are_counted_and_the_rest_is_built(tmp_path):
    points, triangles = sphere(8)
    points = np.concatenate([points, [[np.nan, 0, 0], [0, np.inf, 0]]])
    odd = [[0, 1, len(points) - 2], [0, 1, len(points) - 1], [20, 20, 20], [20, 21, 20]]
    write_ply(tmp_path / "odd.ply", points, np.concatenate([triangles, odd]))
    arguments = ("odd.ply", "-o", "odd.gsb", "--resolution", 32, "--workers", 0)
    said = succeed(tmp_path, "build", *arguments)
    ledger = json.loads(succeed(tmp_path, "info", "odd.gsb", "--json"))["ledger"]
    # The sphere's own poles are degenerate: 16 quads each have one triangle without area.
    assert (ledger["non_finite"], ledger["degenerate"]) == (2, 2 + 2 * 16)
    assert ledger["triangles"] == len(triangles) + 4
    assert "not finite" in said


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads and writes everything")
def test_permissions_are_usage_errors(tmp_path):
    mesh = write_ply(tmp_path / "a.ply", *sphere(4))
    (tmp_path / "closed").mkdir(mode=0o500)
    arguments = ("build", "a.ply", "--resolution", 16, "--workers", 0)
    assert "cannot be written" in fail(tmp_path, 2, *arguments, "-o", "closed/a.gsb")
    mesh.chmod(0)
    assert "cannot be read" in fail(tmp_path, 2, *arguments, "-o", "a.gsb")


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 4 MiB, where this user may mount one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = shutil.which("mount")
    options = ["-t", "tmpfs", "-o", "size=4m", "none", str(disk)]
    done = (
        subprocess.run([mount or "mount", *options], capture_output=True, check=False)
        if mount
        else None
    )
    if done is None or done.returncode != 0:
        pytest.skip("this user may not mount a tmpfs")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def nested_spheres() -> tuple[Floats, Ints]:
    points, triangles = sphere(20)
    radii = np.linspace(0.3, 1, 10)
    return (
        np.concatenate([points * radius for radius in radii]),
        np.concatenate([triangles + len(points) * i for i in range(len(radii))]),
    )


def fill(disk: Path) -> Path:
    """A file that takes all that is left of a file system."""
    filler = disk / "filler"
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(1 << 12))
    return filler


def test_a_disk_that_fills_up_stops_the_job_which_then_resumes(tmp_path, small_disk: Path):
    write_ply(tmp_path / "spheres.ply", *nested_spheres())
    plain = ("build", "spheres.ply", "--resolution", 256, *QUIETLY)
    succeed(tmp_path, *plain, "-o", "plain.gsb")
    subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=True)
    arguments = (*plain, "-o", small_disk / "out.gsb", "--tmp", small_disk)
    command = [str(PROGRAM), *map(str, arguments)]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as job:
        while not list(small_disk.glob("gstream-*/3-presort/*.done")):  # the estimate did fit
            assert job.poll() is None
            time.sleep(0.01)
        filler = fill(small_disk)
        line = job.communicate()[1]
    assert job.returncode == 3
    assert line.count("\n") == 1
    assert "No space left on device" in line
    assert "run the same command again to resume" in line
    assert str(small_disk) in line
    assert not (small_disk / "out.gsb").exists()
    assert not list(small_disk.glob("*.wip"))
    assert list(small_disk.glob("gstream-*/job.json"))
    filler.unlink()
    succeed(tmp_path, *arguments)
    assert (small_disk / "out.gsb").read_bytes() == (tmp_path / "plain.gsb").read_bytes()
    assert [path.name for path in small_disk.iterdir()] == ["out.gsb"]


def test_a_disk_that_a_stream_cannot_fit_stops_the_job_when_that_is_known(
    tmp_path, small_disk: Path
):
    write_ply(tmp_path / "spheres.ply", *nested_spheres())  # more voxels than the size tells
    arguments = ("build", "spheres.ply", "--resolution", 256, *QUIETLY, "-o", small_disk / "a.gsb")
    line = fail(tmp_path, 3, *arguments)
    assert "scratch with the output needs about" in line
    subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=True)
    succeed(tmp_path, *arguments)
    assert [path.name for path in small_disk.iterdir()] == ["a.gsb"]


def test_a_disk_that_is_plainly_too_small_is_refused_before_the_start(tmp_path, small_disk: Path):
    write_ply(tmp_path / "sphere.ply", *sphere(20))
    arguments = ("sphere.ply", "-o", small_disk / "out.gsb", "--resolution", 2048)
    line = fail(tmp_path, 5, "build", *arguments)
    assert "MiB are free" in line
    assert list(small_disk.iterdir()) == []


def test_a_cut_stream_is_refused_by_voxelize_and_check(tmp_path):
    write_ply(tmp_path / "a.ply", *sphere(10))
    succeed(tmp_path, "ingest", "a.ply", "-o", "a.gst", "--workers", 0)
    whole = (tmp_path / "a.gst").read_bytes()
    (tmp_path / "cut.gst").write_bytes(whole[: len(whole) // 2])
    arguments = ("voxelize", "cut.gst", "-o", "out.gsb", "--resolution", 16, "--workers", 0)
    assert "cut.gst" in fail(tmp_path, 4, *arguments)
    assert not (tmp_path / "out.gsb").exists()
    assert gstream(tmp_path, "check", "cut.gst").returncode == 4
