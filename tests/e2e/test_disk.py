"""What is said of disk before the start is what it takes."""

import importlib

import numpy as np
import pytest
from e2e.meshes import sphere, write_coloured_ply

from gstream.job import IngestSettings, Job, VoxelizeSettings
from gstream.run import commands
from gstream.run.estimate import disk_of_stream
from gstream.run.pipeline import run_job
from tests.bench.meshes import write_sphere, write_triangle


@pytest.fixture(scope="module")
def streams(tmp_path_factory):
    """A rough sphere of 100,000 triangles, a smooth one with a picture on it, one triangle."""
    folder = tmp_path_factory.mktemp("streams")
    write_sphere(folder / "rough.ply", 100_000)
    points, triangles = sphere(100)
    colours = np.random.default_rng(1).integers(0, 256, (len(points), 3)).astype(np.uint8)
    write_coloured_ply(folder / "coloured.ply", points, colours, triangles)
    write_triangle(folder / "triangle.ply")
    options = commands.RunOptions(workers=0)
    for name in ("rough", "coloured", "triangle"):
        settings = IngestSettings((str(folder / f"{name}.ply"),))
        commands.ingest(settings, str(folder / f"{name}.gst"), options).run()
    return folder


def voxelized(stream, folder, settings):
    """The run's report, and the bytes of scratch and output that it left."""
    (folder / "scratch").mkdir()
    output = folder / "scene.gsb"
    job = Job(str(folder / "scratch"), str(output), stream, voxelize=settings)
    stages = [importlib.import_module(f"gstream.stages.{name}") for name in commands.VOXELIZE]
    report = run_job(job, stages)
    scratch = sum(f.stat().st_size for f in (folder / "scratch").rglob("*") if f.is_file())
    return report, scratch, output.stat().st_size


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("rough", VoxelizeSettings(resolution=160)),  # 0.8 voxels a triangle
        ("rough", VoxelizeSettings(resolution=160, keep_geometry=True)),
        ("rough", VoxelizeSettings(resolution=512, sep="26")),
        ("coloured", VoxelizeSettings(resolution=512)),
        ("rough", VoxelizeSettings(resolution=160, columns=())),
        ("triangle", VoxelizeSettings(resolution=2048)),
    ],
)
def test_the_estimate_is_within_a_quarter_of_what_is_used(streams, tmp_path, name, settings):
    stream = str(streams / f"{name}.gst")
    _, scratch, output = voxelized(stream, tmp_path, settings)
    need = disk_of_stream(stream, settings)
    assert 0.8 <= (need.scratch + need.output) / (scratch + output) <= 1.25


def test_triangles_that_share_vertices_take_at_most_16_bytes_of_scratch(streams, tmp_path):
    settings = VoxelizeSettings(resolution=160)
    report, scratch, output = voxelized(str(streams / "rough.gst"), tmp_path, settings)
    assert scratch <= 16 * report.stages[0].counts["triangles"] + 1.3 * output
