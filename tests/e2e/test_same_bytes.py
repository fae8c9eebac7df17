"""What must not change a byte of the block file, and what the whole pipeline must agree with."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from e2e.meshes import Floats, Ints, sphere, write_coloured_ply, write_ply

import gstream
from gstream.grid import grid_of
from gstream.kernels.snap import snap
from gstream.kernels.voxelize import voxelize_triangles
from gstream.stages import voxelize

RESOLUTION = 200
MODES = [("6", "one-sided"), ("26", "closed"), ("conservative", "one-sided")]


def scene() -> tuple[Floats, np.ndarray[Any, Any], Ints]:
    """A sphere, one triangle across everything, needles, a collinear and a point-like triangle."""
    points, triangles = sphere(24)
    extra = np.array(
        [
            [-1.9, -1.7, -1.8], [2.0, 1.1, -0.4], [0.3, 1.9, 1.7],
            [1.5, 1.5, 1.5], [1.5, -1.5, 1.5], [1.5, -1.5, 1.5000001],
            [0, 0, 0], [0.5, 0.25, 0.125], [1.0, 0.5, 0.25],
        ]
    )  # fmt: skip
    n = len(points)
    more = np.arange(9).reshape(3, 3) + n
    point = np.array([[n, n, n]])
    points = np.concatenate([points, extra])
    colours = np.random.default_rng(5).integers(0, 256, (len(points), 3)).astype(np.uint8)
    return points, colours, np.concatenate([triangles, more, point])


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_coloured_ply(tmp_path_factory.mktemp("scene") / "scene.ply", *scene())


def build(mesh: Path, folder: Path, *, ingest: dict[str, Any] | None = None, **more: Any) -> bytes:
    output = folder / "out.gsb"
    settings = {"resolution": RESOLUTION, "block": 16, "workers": 0, "force": True, **more}
    gstream.build(mesh, output, ingest=ingest, **settings)
    return output.read_bytes()


@pytest.mark.parametrize(("sep", "ties"), MODES)
def test_cells_of_any_size_give_the_same_bytes(mesh, tmp_path, sep, ties):
    # Cells of 16 are single blocks, whose levels simplify makes; one of 256 makes all of them.
    files = {build(mesh, tmp_path, sep=sep, ties=ties, cell=cell) for cell in (16, 32, 128, 256)}
    assert len(files) == 1


@pytest.mark.parametrize("triangles", [1, 1000, 65_536])
@pytest.mark.parametrize("order", ["file", "spatial", "smallest"])
def test_chunks_of_any_size_and_order_give_the_same_bytes(mesh, tmp_path, triangles, order):
    ingest = {"chunk_triangles": triangles, "order": order}
    assert build(mesh, tmp_path, ingest=ingest) == build(mesh, tmp_path)


@pytest.mark.parametrize(("sep", "ties"), MODES)
def test_shuffled_triangles_and_turned_corners_give_the_same_bytes(mesh, tmp_path, sep, ties):
    points, colours, triangles = scene()
    rng = np.random.default_rng(1)
    turned = np.array([np.roll(t, rng.integers(3)) for t in rng.permutation(triangles)])
    renamed = rng.permutation(len(points))
    turned = np.argsort(renamed)[turned]
    other = write_coloured_ply(tmp_path / "o.ply", points[renamed], colours[renamed], turned)
    same = build(other, tmp_path, sep=sep, ties=ties)
    assert same == build(mesh, tmp_path, sep=sep, ties=ties)


def test_a_cell_too_dense_for_the_memory_is_split_and_gives_the_same_bytes(
    mesh, tmp_path, monkeypatch
):
    whole = build(mesh, tmp_path, sep="26")
    grown = []
    monkeypatch.setattr(voxelize, "LEAST_BOX_BYTES", 600_000)
    monkeypatch.setattr(voxelize, "UNIT_BYTES", 1 << 40)
    fill = voxelize.Filling._fill
    monkeypatch.setattr(
        voxelize.Filling, "_fill", lambda *a: grown.append(a[2]) or fill(*a), raising=True
    )
    assert build(mesh, tmp_path, sep="26") == whole
    assert min(grown) < 256


@pytest.mark.parametrize("more", [{"lod": False}, {"keep_weights": True}])
def test_cells_give_the_same_bytes_with_their_weights(mesh, tmp_path, more):
    assert build(mesh, tmp_path, cell=16, **more) == build(mesh, tmp_path, cell=64, **more)


def test_triangles_that_set_no_voxel_give_a_valid_file_of_none(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 1]]) * 1e-6
    corners = np.concatenate([points, 1 - points])
    small = write_ply(tmp_path / "small.ply", corners, np.arange(6).reshape(2, 3))
    build(small, tmp_path, sep="6", resolution=300)
    assert gstream.check(tmp_path / "out.gsb").ok
    with gstream.open(tmp_path / "out.gsb") as file:
        assert file.metadata["ledger"]["voxels"] == [0] * file.levels


def test_two_files_of_halves_give_the_voxels_of_the_whole(tmp_path, mesh):
    points, colours, triangles = scene()
    halves = [
        write_coloured_ply(tmp_path / f"{i}.ply", points, colours, part)
        for i, part in enumerate(np.array_split(triangles, 2))
    ]
    gstream.build(halves, tmp_path / "two.gsb", resolution=RESOLUTION, block=16, workers=0)
    assert (tmp_path / "two.gsb").read_bytes() == build(mesh, tmp_path)


@pytest.mark.parametrize("snap_bits", [None, 3])
@pytest.mark.parametrize(("sep", "ties"), MODES)
def test_the_pipeline_sets_the_voxels_and_fates_of_one_exact_box(
    mesh, tmp_path, sep, ties, snap_bits
):
    build(mesh, tmp_path, sep=sep, ties=ties, cell=32, snap_bits=snap_bits)
    points, _, triangles = scene()
    box = (tuple(points[triangles].min((0, 1))), tuple(points[triangles].max((0, 1))))
    grid = grid_of(RESOLUTION, None, box, None, snap_bits)
    snapped = np.empty((len(points), 3), np.int64)
    snap(points, np.array(grid.origin), 2.0**grid.snap_bits / grid.voxel_size, snapped)
    truth = voxelize_triangles(snapped[triangles], grid.snap_bits, (0, 0, 0), 256, sep, ties)
    with gstream.open(tmp_path / "out.gsb") as file:
        blocks = [view.positions() for view in file.blocks(0)]
        masks = np.concatenate([view.mask for view in file.blocks(0)])
        ledger = file.metadata["ledger"]
    found = np.concatenate(blocks)
    order, kept = np.lexsort(found.T), truth.hit
    wanted = np.lexsort(truth.voxel[kept].T)
    np.testing.assert_array_equal(found[order], truth.voxel[kept][wanted])
    expected = truth.mask[kept][wanted]
    np.testing.assert_array_equal(masks[order], np.where(expected == 0, 63, expected))
    assert ledger["assigned"] == np.count_nonzero(truth.assigned)
    assert ledger["unassigned"] == np.count_nonzero(~truth.assigned)
    assert ledger["fragments"] == truth.fragments
    assert ledger["area_total"] == truth.area.sum()
    assert ledger["area_pruned"] == truth.area[~kept].sum()
    edges = snapped[triangles][:, 1:] - snapped[triangles][:, :1]
    assert ledger["degenerate"] == np.count_nonzero(~np.cross(edges[:, 0], edges[:, 1]).any(1))


def test_bounds_crop_the_scene_and_every_triangle_is_accounted_for(mesh, tmp_path):
    bounds = (-1.0, -1.0, 0.0, 0.0, 0.0, 1.0)
    build(mesh, tmp_path, ingest={"bounds": bounds}, sep="conservative", resolution=64)
    with gstream.open(tmp_path / "out.gsb") as file:
        ledger, low, high = file.metadata["ledger"], np.inf, -np.inf
        for view in file.blocks(0):
            low, high = min(low, view.positions().min()), max(high, view.positions().max())
    assert ledger["outside"] > 0
    assert ledger["unassigned"] == 0
    assert ledger["triangles"] == ledger["assigned"] + ledger["outside"]
    assert low >= 0
    assert high < 64


def test_simplify_makes_the_levels_that_build_makes(mesh, tmp_path):
    from click.testing import CliRunner

    from gstream_cli.main import main

    flat, full = tmp_path / "flat.gsb", tmp_path / "full.gsb"
    build(mesh, tmp_path, lod=False)
    (tmp_path / "out.gsb").rename(flat)
    arguments = ["simplify", str(flat), "-o", str(full), "--workers", "0", "--quiet"]
    done = CliRunner().invoke(main, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert full.read_bytes() == build(mesh, tmp_path, keep_weights=True)
    assert gstream.check(full).ok
