"""Ingest: every triangle of the inputs is in the stream once, or counted as left out."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream.errors import InputError, StoppedError, UsageError
from gstream.formats.stream import StreamReader, corners
from gstream.formats.stream_check import iter_findings
from gstream.job import IngestSettings, Job
from gstream.kernels import indexing
from gstream.kernels.neighbours import follow_edges
from gstream.readers.mesh import DiskArray, Mesh
from gstream.stages import ingest

SETTINGS = IngestSettings(("a.ply",), chunk_triangles=32)


def on_disk(folder, name, array, skip=1, stride=None):
    """Write an array at an odd offset, each row padded to `stride` bytes."""
    width = array.itemsize * int(np.prod(array.shape[1:]))
    rows = np.ascontiguousarray(array).view(np.uint8)
    stride = stride or width
    data = np.full((len(array), stride), 0xEE, np.uint8)
    data[:, :width] = rows.reshape(len(array), width)
    path = folder / name
    path.write_bytes(b"\xdd" * skip + data.tobytes())
    inner = np.zeros(array.shape[1:], array.dtype).strides
    return DiskArray(str(path), skip, array.dtype.str, array.shape, (stride, *inner))


def mesh_of(folder, positions, triangles=None, name="a.ply", stride=None, **more):
    arrays = {key: on_disk(folder, f"{name}.{key}", value) for key, value in more.items()}
    rows = None if triangles is None else on_disk(folder, f"{name}.i", triangles, 3, stride)
    count = len(positions) if triangles is None else len(triangles)
    points = on_disk(folder, f"{name}.p", positions)
    return Mesh(str(folder / name), points, rows, count, faces=count, **arrays)


def job_of(folder, meshes, settings=SETTINGS):
    spill = folder / "1-spill"
    spill.mkdir(exist_ok=True)
    for index, mesh in enumerate(meshes):
        (spill / f"{index}.json").write_bytes(mesh.to_json())
    settings = replace(settings, inputs=tuple(mesh.name for mesh in meshes))
    return Job(str(folder), str(folder / "o.gsb"), str(folder / "out" / "x.gst"), settings)


def run(job, order=1):
    for unit in ingest.plan(job)[::order]:
        ingest.work(job, unit)
    summary = ingest.finish(job)
    assert list(iter_findings(job.stream)) == []
    return summary, StreamReader(job.stream)


def soup_of(reader):
    """The multiset of all stored triangles, as the bits of their corners."""
    found = Counter()
    for index in range(len(reader.chunks)):
        found.update(triangle.tobytes() for triangle in corners(reader.chunk(index))[0])
    return found


def rough_sheet(side=20, seed=1):
    """Positions and triangles of a rough height field, 2 (side - 1)^2 triangles."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    points = np.stack([x, y, random.normal(size=(side, side))], axis=2).reshape(-1, 3)
    first = (side * np.arange(side - 1)[:, None] + np.arange(side - 1)).ravel()
    quads = [first, first + 1, first + side, first + 1, first + side + 1, first + side]
    return points.astype(np.float32), np.stack(quads, axis=1).reshape(-1, 3).astype(np.uint32)


@pytest.mark.parametrize("points", ["<f4", ">f4", "<f8", ">f8"])
@pytest.mark.parametrize("ids", ["<u2", ">u2", "<i4", ">i4", "<u4", "<i8"])
@pytest.mark.parametrize("stride", [None, 25])
def test_every_layout_of_a_mesh_gives_the_same_triangles(tmp_path, points, ids, stride):
    positions, triangles = rough_sheet()
    mesh = mesh_of(tmp_path, positions.astype(points), triangles.astype(ids), stride=stride)
    summary, reader = run(job_of(tmp_path, [mesh]))
    native = positions.astype(np.dtype(points).newbyteorder("="))
    assert soup_of(reader) == Counter(native[t].tobytes() for t in triangles)
    assert summary.counts["stored"] == summary.counts["read"] == len(triangles)


@pytest.mark.parametrize("chunk_triangles", [1, 7, 100, 65_536])
@pytest.mark.parametrize("order", ["file", "spatial", "smallest"])
def test_neither_chunk_size_nor_order_changes_the_set_of_triangles(
    tmp_path, chunk_triangles, order
):
    positions, triangles = rough_sheet()
    mesh = mesh_of(tmp_path, positions, triangles)
    settings = replace(SETTINGS, chunk_triangles=chunk_triangles, order=order)
    _, reader = run(job_of(tmp_path, [mesh], settings))
    assert soup_of(reader) == Counter(positions[t].tobytes() for t in triangles)
    assert reader.chunks["triangles"].max() <= chunk_triangles


def test_spatial_order_makes_the_chunks_smaller(tmp_path):
    positions, triangles = rough_sheet()
    triangles = np.random.default_rng(2).permutation(triangles)
    extents = []
    for order in ("file", "spatial"):
        folder = tmp_path / order
        folder.mkdir()
        mesh = mesh_of(folder, positions, triangles)
        _, reader = run(job_of(folder, [mesh], replace(SETTINGS, order=order)))
        boxes = reader.chunks["box"]
        extents.append((boxes[:, 1] - boxes[:, 0])[:, :2].prod(axis=1).mean())
    assert extents[1] < extents[0] / 2


def test_a_chunk_holds_the_next_triangles_of_the_file_however_scattered_they_are(tmp_path):
    positions, triangles = rough_sheet()
    shuffled = np.random.default_rng(2).permutation(triangles)
    _, reader = run(job_of(tmp_path, [mesh_of(tmp_path, positions, shuffled)]))
    at = 0
    for index in range(len(reader.chunks)):
        found = corners(reader.chunk(index))[0]
        wanted = positions[shuffled[at : at + len(found)]]
        assert Counter(map(bytes, found)) == Counter(map(bytes, wanted))
        at += len(found)
    assert at == len(triangles)


def test_a_chunk_that_is_one_piece_keeps_the_order_of_the_file(tmp_path):
    positions, triangles = rough_sheet(40)
    turned = np.roll(triangles[::-1], 1, axis=1)
    mesh = mesh_of(tmp_path, positions, turned)
    _, reader = run(job_of(tmp_path, [mesh], replace(SETTINGS, chunk_triangles=65_536)))
    np.testing.assert_array_equal(corners(reader.chunk(0))[0], positions[turned])


@pytest.mark.parametrize(
    ("order", "lz4", "most"),
    [("file", "fast", 10.5), ("spatial", "fast", 2.8), ("spatial", "hc", 2.5)],
)
def test_a_shuffled_sheet_takes_few_bytes_per_triangle(tmp_path, order, lz4, most):
    # 13.3, 5.8 and 4.9 with its triangles in the order in which they come.
    positions, triangles = rough_sheet(120)
    shuffled = np.random.default_rng(2).permutation(triangles)
    settings = replace(SETTINGS, chunk_triangles=16_384, order=order, lz4=lz4)
    _, reader = run(job_of(tmp_path, [mesh_of(tmp_path, positions, shuffled)], settings))
    assert reader.file_length / len(triangles) < most


@pytest.mark.parametrize("shuffle", [True, False])
def test_the_smallest_order_is_the_one_that_takes_fewer_bytes(tmp_path, shuffle):
    positions, triangles = rough_sheet(40)
    if shuffle:
        triangles = np.random.default_rng(2).permutation(triangles)
    mesh, files = mesh_of(tmp_path, positions, triangles), {}
    for order in ("file", "spatial", "smallest"):
        job = job_of(tmp_path, [mesh], replace(SETTINGS, order=order, chunk_triangles=65_536))
        run(job)
        files[order] = Path(job.stream).read_bytes()
    assert files["smallest"] == files["spatial" if shuffle else "file"]
    assert len(files["smallest"]) == min(map(len, files.values()))


def test_the_order_of_units_does_not_change_a_byte(tmp_path):
    positions, triangles = rough_sheet(40)
    mesh = mesh_of(tmp_path, positions, triangles)
    job = job_of(tmp_path, [mesh])
    assert len(ingest.plan(job)) > 3
    files = []
    for order in (1, -1):
        run(job, order)
        with open(job.stream, "rb") as file:
            files.append(file.read())
    assert files[0] == files[1]


def test_triangles_with_nan_or_infinity_are_left_out_and_counted(tmp_path):
    positions, triangles = rough_sheet()
    positions[[5, 77, 78]] = [[np.nan, 0, 0], [0, np.inf, 0], [0, 0, -np.inf]]
    bad = np.isin(triangles, [5, 77, 78]).any(axis=1)
    summary, reader = run(job_of(tmp_path, [mesh_of(tmp_path, positions, triangles)]))
    assert soup_of(reader) == Counter(positions[t].tobytes() for t in triangles[~bad])
    assert summary.counts["non_finite"] == bad.sum()
    source = reader.totals["sources"][0]
    assert source["read"] == source["stored"] + source["non_finite"] == len(triangles)


def test_non_finite_triangles_at_the_end_are_counted_in_a_chunk_of_no_triangles(tmp_path):
    positions, triangles = rough_sheet()
    positions = np.concatenate([positions, np.full((1, 3), np.nan, np.float32)])
    last = np.full((40, 3), len(positions) - 1, np.uint32)
    mesh = mesh_of(tmp_path, positions, np.concatenate([triangles, last]))
    summary, reader = run(job_of(tmp_path, [mesh]))
    assert summary.counts["non_finite"] == 40
    assert reader.chunks["triangles"][-1] == 0


def test_degenerate_triangles_are_stored_and_counted(tmp_path):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0]], np.float32)
    triangles = np.array([[0, 1, 2], [1, 1, 2], [0, 3, 1], [2, 2, 2]], np.uint32)
    summary, reader = run(job_of(tmp_path, [mesh_of(tmp_path, positions, triangles)]))
    assert (summary.counts["stored"], summary.counts["degenerate"]) == (4, 3)
    assert soup_of(reader) == Counter(positions[t].tobytes() for t in triangles)


@pytest.mark.parametrize(("index", "dtype"), [(400, "<u4"), (2**32 - 1, "<u4"), (-1, "<i4")])
def test_an_index_out_of_range_is_told_with_face_index_and_count(tmp_path, index, dtype):
    positions, triangles = rough_sheet()
    triangles = triangles.astype(np.int64)
    triangles[600, 1] = index
    job = job_of(tmp_path, [mesh_of(tmp_path, positions, triangles.astype(dtype))])
    with pytest.raises(InputError, match=rf"face 600 .*there is no vertex {index} of 400"):
        run(job)


def test_a_soup_is_welded_where_all_bits_are_equal(tmp_path):
    positions, triangles = rough_sheet()
    mesh = mesh_of(tmp_path, positions[triangles])
    _, reader = run(job_of(tmp_path, [mesh], replace(SETTINGS, chunk_triangles=65_536)))
    assert soup_of(reader) == Counter(positions[t].tobytes() for t in triangles)
    assert reader.chunks["vertices"].sum() == len(positions)


def test_a_soup_is_not_welded_across_different_normals_or_the_sign_of_zero(tmp_path):
    corner = np.zeros((8, 3, 3), np.float32)
    corner[:, 1, 0] = corner[:, 2, 1] = 1
    corner[4:, 0, 2] = -0.0
    normals = np.zeros((24, 3), np.float32)
    normals[9:, 2] = 1
    mesh = mesh_of(tmp_path, corner, normals=normals)
    _, reader = run(job_of(tmp_path, [mesh]))
    chunk = reader.chunk(0)
    seen = {(p.tobytes(), n.tobytes()) for p, n in zip(chunk.positions, chunk.normals, strict=True)}
    assert len(chunk.positions) == len(seen) == 7
    _, found, _ = corners(chunk)
    np.testing.assert_array_equal(found.reshape(-1, 3), normals)


def test_triangles_that_share_nothing_are_stored_without_indices(tmp_path):
    positions = np.random.default_rng(4).normal(size=(60, 3)).astype(np.float32)
    triangles = np.arange(60, dtype=np.uint32).reshape(-1, 3)
    _, reader = run(job_of(tmp_path, [mesh_of(tmp_path, positions, triangles)]))
    assert reader.head(0).index_bytes == 0
    np.testing.assert_array_equal(reader.chunk(0).positions, positions)


def test_a_chunk_ends_before_its_vertices_exceed_65536(tmp_path):
    count = 30_000
    positions = np.random.default_rng(4).normal(size=(3 * count, 3)).astype(np.float32)
    triangles = np.arange(3 * count, dtype=np.uint32).reshape(-1, 3)
    mesh = mesh_of(tmp_path, positions, triangles)
    _, reader = run(job_of(tmp_path, [mesh], replace(SETTINGS, chunk_triangles=65_536)))
    assert reader.chunks["triangles"].tolist() == [21_845, 8_155]


@pytest.mark.parametrize("components", [3, 4])
@pytest.mark.parametrize("order", ["file", "spatial"])
def test_vertex_colours_and_normals_follow_their_vertices(tmp_path, components, order):
    positions, triangles = rough_sheet()
    random = np.random.default_rng(6)
    triangles = random.permutation(triangles)
    colours = random.integers(0, 256, (400, components), np.uint8)
    normals = random.normal(size=(400, 3)).astype(np.float32)
    mesh = mesh_of(tmp_path, positions, triangles, colours=colours, normals=normals)
    _, reader = run(job_of(tmp_path, [mesh], replace(SETTINGS, order=order)))
    rgba = np.full((400, 4), 255, np.uint8)
    rgba[:, :components] = colours
    place = {point.tobytes(): vertex for vertex, point in enumerate(positions)}
    for index in range(len(reader.chunks)):
        points, found_normals, found_colours = corners(reader.chunk(index))
        rows = [place[point.tobytes()] for point in points.reshape(-1, 3)]
        np.testing.assert_array_equal(found_normals.reshape(-1, 3), normals[rows])
        np.testing.assert_array_equal(found_colours.reshape(-1, 4), rgba[rows])


@pytest.mark.parametrize("order", ["file", "spatial", "smallest"])
def test_triangle_colours_follow_their_triangles(tmp_path, order):
    positions, triangles = rough_sheet()
    positions[77] = np.nan
    colours = np.random.default_rng(6).integers(0, 256, (len(triangles), 4), np.uint8)
    mesh = mesh_of(tmp_path, positions, triangles, triangle_colours=colours)
    _, reader = run(job_of(tmp_path, [mesh], replace(SETTINGS, order=order)))
    expected = {positions[t].tobytes(): c for t, c in zip(triangles, colours, strict=True)}
    for index in range(len(reader.chunks)):
        chunk = reader.chunk(index)
        assert chunk.colour_domain == 2
        for triangle, colour in zip(corners(chunk)[0], chunk.colours, strict=True):
            np.testing.assert_array_equal(colour, expected[triangle.tobytes()])


def test_inputs_of_float32_and_float64_share_one_stream_without_loss(tmp_path):
    positions, triangles = rough_sheet()
    doubles = positions.astype(np.float64) + 1e-12
    first = mesh_of(tmp_path, positions, triangles, "a.ply")
    second = mesh_of(tmp_path, doubles, triangles, "b.ply")
    _, reader = run(job_of(tmp_path, [first, second]))
    expected = [array[t].tobytes() for array in (positions, doubles) for t in triangles]
    assert soup_of(reader) == Counter(expected)
    assert [source["name"] for source in reader.totals["sources"]] == ["a.ply", "b.ply"]


def test_the_file_names_no_folder(tmp_path):
    positions, triangles = rough_sheet()
    job = job_of(tmp_path, [mesh_of(tmp_path, positions, triangles)])
    run(job)
    with open(job.stream, "rb") as file:
        assert str(tmp_path).encode() not in file.read()


def test_metadata_and_declared_bounds_are_kept(tmp_path):
    positions, triangles = rough_sheet()
    said = replace(SETTINGS, metadata={"units": "m", "crs": None}, bounds=(0, 0, 0, 9, 9, 9.5))
    _, reader = run(job_of(tmp_path, [mesh_of(tmp_path, positions, triangles)], said))
    assert reader.metadata == {"units": "m", "crs": None, "bounds": [0, 0, 0, 9, 9, 9.5]}


@pytest.mark.parametrize("soup", [True, False])
def test_a_mesh_of_nothing_finite_is_refused(tmp_path, soup):
    positions = np.full((9, 3), np.nan, np.float32)
    triangles = np.arange(9, dtype=np.uint32).reshape(-1, 3)
    mesh = mesh_of(tmp_path, positions.reshape(3, 3, 3) if soup else positions,
                   None if soup else triangles)  # fmt: skip
    with pytest.raises(InputError, match="all 3 triangles have NaN or infinite coordinates"):
        run(job_of(tmp_path, [mesh]))


def test_a_mesh_without_triangles_is_refused(tmp_path):
    mesh = mesh_of(tmp_path, np.zeros((4, 3), np.float32), np.zeros((0, 3), np.uint32))
    with pytest.raises(InputError, match="not one triangle"):
        run(job_of(tmp_path, [mesh]))


def test_finish_names_a_missing_unit_and_writes_nothing(tmp_path):
    positions, triangles = rough_sheet(40)
    job = job_of(tmp_path, [mesh_of(tmp_path, positions, triangles)])
    for unit in ingest.plan(job)[:-1]:
        ingest.work(job, unit)
    with pytest.raises(StoppedError, match=r"1 of 6 units are not done, the first is 2-ingest/"):
        ingest.finish(job)
    assert not (tmp_path / "out" / "x.gst").exists()


@pytest.mark.parametrize("count", [0, 65_537])
def test_a_chunk_size_out_of_range_is_refused(tmp_path, count):
    mesh = mesh_of(tmp_path, *rough_sheet())
    with pytest.raises(UsageError, match="--chunk-triangles"):
        ingest.plan(job_of(tmp_path, [mesh], replace(SETTINGS, chunk_triangles=count)))


def test_a_flat_scene_and_a_single_point_are_stored_in_spatial_order_too(tmp_path):
    positions = np.full((4, 3), 7e30, np.float32)
    triangles = np.zeros((50, 3), np.uint32)
    settings = replace(SETTINGS, order="spatial")
    summary, _ = run(job_of(tmp_path, [mesh_of(tmp_path, positions, triangles)], settings))
    assert summary.counts["stored"] == summary.counts["degenerate"] == 50


BITS32 = st.sampled_from([0.0, -0.0, 1.0, 1e-45, 3e38, -3e38, float("nan"), float("inf")])


@given(
    points=st.lists(st.tuples(BITS32, BITS32, BITS32), min_size=1, max_size=8),
    seed=st.integers(0, 99),
    order=st.sampled_from(["file", "spatial", "smallest"]),
    size=st.integers(1, 9),
)
def test_any_small_mesh_is_stored_or_counted(tmp_path_factory, points, seed, order, size):
    folder = tmp_path_factory.mktemp("any")
    positions = np.array(points, np.float32)
    triangles = np.random.default_rng(seed).integers(0, len(points), (20, 3)).astype(np.uint32)
    finite = np.isfinite(positions).all(axis=1)[triangles].all(axis=1)
    settings = replace(SETTINGS, order=order, chunk_triangles=size)
    job = job_of(folder, [mesh_of(folder, positions, triangles)], settings)
    if not finite.any():
        with pytest.raises(InputError):
            run(job)
        return
    _, reader = run(job)
    assert soup_of(reader) == Counter(positions[t].tobytes() for t in triangles[finite])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("soup", [True, False])
def test_nothing_is_compiled_after_warm(tmp_path, dtype, soup):
    ingest.warm()
    kernels = [*vars(indexing).values(), follow_edges]
    compiled = [kernel for kernel in kernels if hasattr(kernel, "signatures")]
    before = [len(kernel.signatures) for kernel in compiled]
    positions, triangles = rough_sheet()
    positions = positions.astype(dtype)
    mesh = mesh_of(tmp_path, positions[triangles] if soup else positions,
                   None if soup else triangles)  # fmt: skip
    job = job_of(tmp_path, [mesh], replace(SETTINGS, order="spatial"))
    run(job)
    reader = StreamReader(job.stream, indexing)
    assert reader.chunk(0).triangle_count
    assert [len(kernel.signatures) for kernel in compiled] == before
