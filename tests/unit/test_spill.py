"""Stage 1: one unit per input, resumable, with counts that add up."""

from pathlib import Path

import pytest

from gstream.errors import InputError, StoppedError, UsageError
from gstream.job import IngestSettings, Job
from gstream.readers.mesh import Mesh
from gstream.run.publish import Scratch
from gstream.stages import spill

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nl 1 2\n"


def make_job(folder: Path, *inputs: Path) -> Job:
    settings = IngestSettings(tuple(map(str, inputs)))
    return Job(str(folder / "job"), str(folder / "out.gst"), str(folder / "out.gst"), settings)


def write_inputs(folder: Path) -> tuple[Path, Path]:
    obj, stl = folder / "a.obj", folder / "b.stl"
    obj.write_text(SQUARE)
    stl.write_bytes(bytes(80) + (3).to_bytes(4, "little") + bytes(150))
    return obj, stl


def test_every_input_becomes_one_mesh_and_the_counts_add_up(tmp_path):
    job = make_job(tmp_path, *write_inputs(tmp_path))
    units = spill.plan(job)
    assert [unit.data for unit in units] == [(i, p) for i, p in enumerate(job.ingest.inputs)]
    for unit in units:
        spill.work(job, unit)
    assert spill.finish(job).counts == {
        "faces": 4, "inputs": 2, "skipped_faces": 1, "triangles": 5, "vertices": 13,
    }  # fmt: skip
    with Scratch(job) as scratch:
        mesh = Mesh.from_json(scratch.read("1-spill/0.json"))
        assert mesh.name == str(tmp_path / "a.obj")
        assert mesh.triangles.map().tolist() == [[0, 1, 2], [0, 2, 3]]
        assert Mesh.from_json(scratch.read("1-spill/1.json")).positions.path == str(
            tmp_path / "b.stl"
        )


def test_a_mapped_input_leaves_only_its_description_in_scratch(tmp_path):
    _, stl = write_inputs(tmp_path)
    job = make_job(tmp_path, stl)
    spill.work(job, spill.plan(job)[0])
    names = sorted(p.name for p in (tmp_path / "job" / "1-spill").iterdir())
    assert names == ["0.done", "0.json"]


def test_a_unit_may_run_again_and_gives_the_same_files(tmp_path):
    job = make_job(tmp_path, *write_inputs(tmp_path))
    unit = spill.plan(job)[0]

    def run() -> dict[str, bytes]:
        spill.work(job, unit)
        return {p.name: p.read_bytes() for p in (tmp_path / "job" / "1-spill").iterdir()}

    first = run()
    assert set(first) == {"0-positions", "0-triangles", "0.done", "0.json"}
    assert run() == first


def test_a_unit_whose_spilled_file_was_cut_is_not_done(tmp_path):
    job = make_job(tmp_path, *write_inputs(tmp_path))
    for unit in spill.plan(job):
        spill.work(job, unit)
    (tmp_path / "job" / "1-spill" / "0-positions").write_bytes(b"")
    with pytest.raises(StoppedError, match=r"1 of 2 inputs are not opened, the first is .*a.obj"):
        spill.finish(job)


def test_a_missing_or_invalid_input_is_refused_by_the_plan(tmp_path):
    (tmp_path / "b.ply").write_bytes(b"ply\n")
    with pytest.raises(UsageError, match=r"none\.obj"):
        spill.plan(make_job(tmp_path, tmp_path / "none.obj"))
    with pytest.raises(InputError, match=r"b\.ply"):
        spill.plan(make_job(tmp_path, tmp_path / "b.ply"))


def test_a_mapped_input_costs_and_needs_less_than_a_spilled_one(tmp_path):
    spilled, mapped = spill.plan(make_job(tmp_path, *write_inputs(tmp_path)))
    assert mapped.cost < spilled.cost
    assert mapped.memory < spilled.memory
