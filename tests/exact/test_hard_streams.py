"""Hard streams: nothing in them, signs of zero, denormals, far and flat scenes, totals above 2^32.

The judge of the snapping is exact: Fractions of the float64 numbers that grid and input hold.
"""

import os
from dataclasses import replace
from fractions import Fraction
from math import floor, nextafter
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from e2e.meshes import write_coloured_ply
from exact import oracle, scenes
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

import gstream
from gstream.errors import SceneError, UsageError
from gstream.formats.blockfile import write_block_file
from gstream.formats.blockhead import BlockFileHeader
from gstream.formats.columns import CODEC_CONSTANT, column_specs
from gstream.formats.directory import STATE_DATA, pile_dtype
from gstream.formats.stream import (
    POSITION_F4,
    ROW,
    Chunk,
    StreamReader,
    StreamWriter,
    encode_chunk,
)
from gstream.formats.stream_check import COUNTERS
from gstream.grid import Box, Grid, grid_of
from gstream.job import Job, VoxelizeSettings
from gstream.kernels.snap import snap
from gstream.kernels.voxelize import voxelize_triangles
from gstream.run import commands
from gstream.stages import presort

Floats = NDArray[np.float64]


def box_of(points: Floats) -> Box:
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def snapped(points: Floats, grid: Grid) -> NDArray[np.int64]:
    out = np.empty(points.shape, np.int64)
    snap(points, np.array(grid.origin), 2.0**grid.snap_bits / grid.voxel_size, out)
    return out


def exactly_snapped(points: Floats, grid: Grid) -> tuple[list[list[int]], float]:
    """What exact arithmetic snaps to; how near a coordinate comes to a tie, in snap units."""
    scale = Fraction(2**grid.snap_bits) / Fraction(grid.voxel_size)
    rows, nearest = [], 1.0
    for point in points.tolist():
        values = [(Fraction(c) - Fraction(o)) * scale + Fraction(1, 2)
                  for c, o in zip(point, grid.origin, strict=True)]  # fmt: skip
        nearest = min(nearest, *(float(abs(v - round(v))) for v in values))
        rows.append([floor(v) for v in values])
    return rows, nearest


def finest(path: Path) -> dict[tuple[int, int, int], tuple[int, ...]]:
    """Mask and colour of every finest voxel of a file that check accepts."""
    assert gstream.check(path).ok
    found: dict[tuple[int, int, int], tuple[int, ...]] = {}
    with gstream.open(path) as file:
        for view in file.blocks(0):
            assert np.isfinite(view.normals()).all()
            values = np.column_stack([view.mask, view.colour]).tolist()
            found.update(
                zip(map(tuple, view.positions().tolist()), map(tuple, values), strict=True)
            )
    return found


def build(folder: Path, points: Any, triangles: Any = None, **settings: Any) -> Path:
    points = np.asarray(points, float)
    triangles = np.arange(len(points)).reshape(-1, 3) if triangles is None else triangles
    colours = np.random.default_rng(5).integers(0, 256, (len(points), 3)).astype(np.uint8)
    mesh = write_coloured_ply(folder / "mesh.ply", points, colours, np.asarray(triangles))
    more = {"block": 16, "workers": 0, "force": True, **settings}
    gstream.build(mesh, folder / "out.gsb", **more)
    return folder / "out.gsb"


@pytest.mark.parametrize("chunks", [0, 2])
def test_a_stream_without_triangles_is_valid_and_no_grid_is_laid_around_it(tmp_path, chunks):
    """H-GS-1. Without chunks, and with chunks of nothing; meshes without triangles are refused."""
    stream, output = tmp_path / "empty.gst", tmp_path / "out.gsb"
    with stream.open("wb") as file:
        writer = StreamWriter(file, [POSITION_F4], {})
        for _ in range(chunks):
            writer.add_chunk(encode_chunk(Chunk(np.empty((0, 3), np.float32)), "fast"))
        writer.finish({"sources": [dict.fromkeys(COUNTERS, 0)]})
    assert gstream.check(stream).ok
    assert StreamReader(stream).box is None
    options = commands.RunOptions(workers=0)
    request = commands.voxelize(str(stream), VoxelizeSettings(resolution=16), str(output), options)
    with pytest.raises(UsageError, match="has no triangles to voxelize"):
        request.run()
    assert not output.exists()


def test_chunks_of_nothing_beside_others_set_no_voxel(tmp_path):
    """H-GS-1. Each triangle is a chunk of its own; two have no finite corner."""
    points = np.random.default_rng(3).uniform(0, 5, (18, 3))
    given = {"sep": "conservative", "resolution": 16, "ingest": {"chunk_triangles": 1}}
    wanted = finest(build(tmp_path, points, **given))
    points = np.concatenate([points, np.full((6, 3), np.nan)])
    assert finest(build(tmp_path, points, **given)) == wanted


@pytest.mark.parametrize("sep", oracle.SEPARATIONS)
def test_the_sign_of_zero_changes_no_byte_and_a_denormal_no_voxel(tmp_path, sep):
    """H-GS-3. The box of the scene, which the file tells, keeps the denormal."""
    points = np.array([[0, 0, 0], [4, 0, 1], [0, 4, 0], [0, 0, 3], [1, 0, 0], [0, 2, 2]], float)
    given = {"sep": sep, "voxel_size": 0.125}
    plain = build(tmp_path, points, **given)
    data, voxels = plain.read_bytes(), finest(plain)
    zeros = points == 0
    assert build(tmp_path, np.where(zeros, -0.0, points), **given).read_bytes() == data
    for denormal in (5e-324, 2e-310):
        assert finest(build(tmp_path, np.where(zeros, denormal, points), **given)) == voxels


def test_a_mesh_of_1e30_beside_1e_30_keeps_both_in_finite_voxels(tmp_path):
    """H-GS-4. The small triangle is far below a voxel; it is a point of the large one's corner."""
    big = np.array([[0, 0, 0], [1e30, 0, 2e29], [0, 1e30, -3e29]])
    tiny = np.array([[1, 2, 3], [3, 1, 2], [2, 3, 1]]) * 1e-30
    points = np.concatenate([big, tiny])
    path = build(tmp_path, points, sep="conservative", resolution=64)
    grid = grid_of(64, None, box_of(points))
    triangles = snapped(points, grid).reshape(-1, 3, 3)
    wanted: set[tuple[int, int, int]] = set()
    for triangle in triangles:
        wanted |= oracle.voxels_of(triangle, 12, (0, 0, 0), 64, "one-sided")["conservative"]
    assert set(finest(path)) == wanted
    with gstream.open(path) as file:
        ledger = file.metadata["ledger"]
    assert (ledger["triangles"], ledger["assigned"], ledger["degenerate"]) == (2, 2, 1)


@pytest.mark.parametrize("reach", [1e308, 1.7e308])
def test_an_extent_beyond_float64_is_refused_and_not_snapped(tmp_path, reach):
    """H-GS-4. -1e308 to 1e308: the difference of two finite numbers is infinite."""
    points = [[-reach, 0, 0], [reach, 1, 0], [0, reach, 1]]
    with pytest.raises(SceneError, match="beyond double precision"):
        build(tmp_path, points, resolution=16)


@given(
    st.sampled_from([0, 10**6, 10**7, -(10**7), 5 * 10**6]),
    st.lists(st.integers(-5000, 5000), min_size=9, max_size=9),
    st.sampled_from([64, 1000, 16_384, 65_536]),
    st.sampled_from([None, 0.001, 2.0**-10]),
)
def test_millimetres_at_10000_kilometres_are_snapped_once_and_right(
    offset, millimetres, resolution, size
):
    """H-GS-4, K-04. The nearest multiple of 2^-k voxel, by exact arithmetic."""
    points = np.array(millimetres, float).reshape(3, 3) / 1000 + offset
    assume(np.ptp(points, axis=0).max() > 0.5)
    grid = grid_of(None if size else resolution, size, box_of(points))
    exact, tie = exactly_snapped(points, grid)
    assume(tie > 2.0**-16)  # float64 may take the other side of a tie that it cannot see
    assert snapped(points, grid).tolist() == exact


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("offset", [10**6, 10**7])
def test_triangles_of_millimetres_far_out_set_the_voxels_of_their_snapped_corners(offset, ties):
    """H-GS-4. Voxels of a millimetre at 10^6 and 10^7 metres, where float32 holds whole metres."""
    rng = np.random.default_rng(offset)
    for _ in range(12):
        points = offset + rng.uniform(0, 0.008, (3, 3))
        grid = replace(grid_of(None, 0.001, box_of(points)), snap_bits=12)
        low, corners = (0, 0, 0), snapped(points, grid)[None]
        for sep in oracle.SEPARATIONS:
            found = voxelize_triangles(corners, 12, low, 16, sep, ties)
            truth = oracle.voxels_of(corners[0], 12, low, 16, ties)[sep]
            assert {tuple(v) for v in found.voxel[found.hit].tolist()} == truth


@pytest.mark.parametrize("offset", [2**20, 2**24])
def test_moving_a_scene_far_out_by_whole_voxels_moves_its_voxels_alone(tmp_path, offset):
    """H-GS-4. Through reader, stream and snapping: float64 all the way."""
    detail = scenes.soup("generic", 4, 30, 10, (0, 0, 0), 4).reshape(-1, 3) / 2.0**20
    given = {"sep": "26", "voxel_size": 2.0**-10}
    assert finest(build(tmp_path, detail + offset, **given)) == finest(
        build(tmp_path, detail, **given)
    )


AXES = [(0,), (1,), (2,), (0, 1), (1, 2), (0, 2), (0, 1, 2)]


@pytest.mark.parametrize("flat", AXES)
@pytest.mark.parametrize("sep", ["6", "conservative"])
def test_flat_scenes_and_single_points_set_the_voxels_of_the_exact_set(tmp_path, flat, sep):
    """H-GS-5. Extent 0 along one, two and three axes; the largest extent makes the voxel."""
    points = np.random.default_rng(7).uniform(-3, 5, (12, 3))
    points[:, list(flat)] = 1.25
    path = build(tmp_path, points, sep=sep, resolution=16)
    grid = grid_of(16, None, box_of(points))
    assert grid.voxel_size == 1 if len(flat) == 3 else grid.voxel_size < 1
    wanted: set[tuple[int, int, int]] = set()
    for triangle in snapped(points, grid).reshape(-1, 3, 3):
        wanted |= oracle.voxels_of(triangle, 12, (0, 0, 0), 16, "one-sided")[sep]
    found = finest(path)
    assert set(found) == wanted
    if sep == "conservative":
        assert len({v[flat[0]] for v in found}) == 1
        assert len(found) == 1 or len(flat) < 3


extents = st.sampled_from([0.0, 1e-300, 1e-30, 1e-3, 0.1, 1.0, 1 / 3, 7e4, 1e30, 1e300])
resolutions = st.one_of(st.sampled_from([1, 2, 3, 16_384, 65_535, 65_536]), st.integers(1, 65_536))


@given(
    st.lists(extents, min_size=3, max_size=3),
    st.sampled_from([0.0, -0.5, -1.0, 1.0, 100.0, -1e6]),
    resolutions,
)
def test_both_ends_of_the_box_lie_in_voxels_of_the_grid(extent, place, resolution):
    """H-GS-7, H-GS-5. The corner at the maximum is in voxel n - 1 or before, never in n."""
    low = place * max(extent)
    points = np.array([[low] * 3, [low + e for e in extent]])
    grid = grid_of(resolution, None, box_of(points))
    voxels = snapped(points, grid) >> grid.snap_bits
    assert voxels.min() >= 0
    assert voxels.max() < resolution


@given(
    st.integers(-1000, 1000),
    st.integers(0, 200),
    st.sampled_from([0.001, 0.1, 0.125, 1 / 3, 1.0, 7.0]),
    st.sampled_from([-1, 0, 1]),
)
def test_a_corner_on_below_or_above_a_border_lies_in_a_grid_of_given_voxels(
    first, count, size, side
):
    """H-GS-7. One float64 below a border snaps up, into the voxel beyond it."""
    low, high = first * size, (first + count) * size
    high = high if side == 0 else nextafter(high, side * np.inf)
    assume(high >= low)
    points = np.array([[low] * 3, [low, high, high]])
    grid = grid_of(None, size, box_of(points))
    voxels = snapped(points, grid) >> grid.snap_bits
    assert voxels.min() >= 0
    assert voxels.max() < grid.resolution


@pytest.mark.parametrize("extent", [1e-305, 1e-320])
def test_an_extent_too_small_for_float64_is_refused(extent):
    """H-GS-3, H-GS-4."""
    with pytest.raises(SceneError, match="beyond double precision"):
        grid_of(16, None, ((0.0, 0.0, 0.0), (extent, extent, extent)))


@pytest.mark.parametrize("offset", [1e7, 1e16])
def test_a_scene_of_a_few_float64_steps_lies_in_its_grid_or_is_refused(offset):
    """H-GS-4, H-GS-7. An extent of two steps of float64, far out."""
    high = nextafter(offset, np.inf)
    points = np.array([[offset] * 3, [high] * 3])
    try:
        grid = grid_of(16, None, box_of(points))
    except SceneError:
        return
    voxels = snapped(points, grid) >> grid.snap_bits
    assert voxels.min() >= 0
    assert voxels.max() < 16


def test_five_thousand_million_triangles_are_planned_to_the_last(monkeypatch):
    """H-GS-8. 76,294 chunks of 65,536 triangles: units in a row, each chunk in one of them."""
    chunks = np.zeros(76_294, ROW)
    chunks["triangles"] = 65_536
    box = ((0.0,) * 3, (1.0,) * 3)
    reader = SimpleNamespace(chunks=chunks, box=box, attributes=(), metadata={})
    monkeypatch.setattr(presort, "StreamReader", lambda path: reader)
    units = presort.plan(Job("", "", "a.gst", voxelize=VoxelizeSettings(resolution=16_384)))
    firsts, lasts = zip(*(unit.data[1:3] for unit in units), strict=True)
    assert (0, *lasts) == (*firsts, 76_294)
    assert sum(unit.cost for unit in units) == 76_294 * 65_536 > 2**32


class Holes:
    """A file that leaves out what is 16 MiB long, as a hole."""

    def __init__(self, file: Any) -> None:
        self.file = file

    def write(self, data: bytes) -> None:
        if len(data) == 1 << 24:
            self.file.seek(1 << 24, os.SEEK_CUR)
        else:
            self.file.write(data)


@pytest.mark.long
def test_a_block_file_counts_voxels_and_places_payloads_beyond_32_bits(tmp_path):
    """H-GS-8. 260 blocks of 256^3 voxels of a byte: 2^32 + 2^26 of both, in a sparse file."""
    specs, many, size = column_specs(11), 260, 1 << 24
    columns = [specs["occupancy"], specs["mask"]]
    rows = np.zeros(many, pile_dtype(columns))
    rows["key"], rows["count"], rows["state"], rows["high"] = np.arange(many), size, STATE_DATA, 255
    rows["occupancy"]["raw"], rows["occupancy"]["codec"] = 1, CODEC_CONSTANT
    rows["mask"]["stored"] = rows["mask"]["raw"] = size
    rows["mask"]["crc"] = crc32(bytes(size))
    matrix = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    header = BlockFileHeader(65_536, 10, 1, 8, matrix, (0.0,) * 3 + (65_536.0,) * 3)
    path, ledger = tmp_path / "large.gsb", {"triangles": 5 << 32, "area_total": 5 << 58}
    fetch, meta = lambda *_: bytes(size), {"ledger": ledger}
    with path.open("wb") as file:
        write_block_file(Holes(file), header, rows, fetch, meta, columns)
    assert os.stat(path).st_blocks * 512 < 1 << 20
    with gstream.open(path) as file:
        assert file.metadata["ledger"] == {**ledger, "voxels": [many << 24]}
        assert file.head.levels["voxels"].tolist() == [many << 24]
        views = list(file.blocks(0))
        assert [view.key for view in views] == list(range(many))
        assert views[-1].stored("mask") == bytes(size)
        assert path.stat().st_size > 2**32
