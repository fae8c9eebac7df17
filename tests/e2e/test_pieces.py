"""`--keep-geometry`: source triangles through the whole program, and what they must agree with."""

import runpy
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from e2e.meshes import Ints, sphere, write_ply
from e2e.test_same_bytes import scene
from exact import piece_oracle

import gstream
from gstream.digests import block_file_content
from gstream.errors import RefusedError
from gstream.stages import piece_buffer

RESOLUTION, BLOCK = 200, 16
DECODER = Path(__file__).parents[2] / "spec" / "reference_decoder.py"


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    points, _, triangles = scene()
    return write_ply(tmp_path_factory.mktemp("scene") / "scene.ply", points, triangles)


def build(mesh: Path, output: Path, *, ingest: dict[str, Any] | None = None, **more: Any) -> Path:
    settings = {"resolution": RESOLUTION, "block": BLOCK, "workers": 0, "force": True}
    gstream.build(mesh, output, ingest=ingest, **settings | {"keep_geometry": True} | more)
    return output


def triangles_of(path: Path) -> Ints:
    """(n, 3, 3) all pieces of a file, in snap units of the grid."""
    parts = [np.empty((0, 3, 3), np.int64)]
    with gstream.open(path) as file:
        k = file.header.snap_bits
        for view in file.blocks(0):
            vertices, triangles = view.pieces()
            parts.append((vertices + (view.corner << k))[triangles])
    return np.concatenate(parts)


def areas(triangles: Ints) -> np.ndarray[Any, Any]:
    edges = np.diff(triangles.astype(float), axis=1)
    return np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2


def ledger_of(path: Path) -> dict[str, Any]:
    with gstream.open(path) as file:
        return dict(file.metadata["ledger"])


@pytest.mark.parametrize("changes", [
    {"cell": 16}, {"cell": 64}, {"workers": 2},
    {"ingest": {"chunk_triangles": 100}}, {"ingest": {"order": "spatial"}},
])  # fmt: skip
def test_how_a_file_is_made_changes_no_byte_of_its_pieces(mesh, tmp_path, changes):
    other = build(mesh, tmp_path / "b.gsb", **changes)
    assert other.read_bytes() == build(mesh, tmp_path / "a.gsb").read_bytes()


def test_shuffled_triangles_and_turned_corners_give_the_same_pieces(mesh, tmp_path):
    points, _, triangles = scene()
    rng = np.random.default_rng(1)
    turned = np.array([np.roll(t, rng.integers(3)) for t in rng.permutation(triangles)])
    other = write_ply(tmp_path / "o.ply", points, turned)
    same = build(other, tmp_path / "b.gsb").read_bytes()
    assert same == build(mesh, tmp_path / "a.gsb").read_bytes()


def test_pieces_too_many_for_the_memory_are_cut_part_by_part_into_the_same_bytes(
    mesh, tmp_path, monkeypatch
):
    whole = build(mesh, tmp_path / "a.gsb").read_bytes()
    most = max(
        Counter(len(v.pieces().triangles) for v in gstream.open(tmp_path / "a.gsb").blocks(0))
    )
    monkeypatch.setattr(piece_buffer, "PIECE_BYTES", (960 << 20) // (2 * most))
    assert build(mesh, tmp_path / "b.gsb").read_bytes() == whole
    monkeypatch.setattr(piece_buffer, "PIECE_BYTES", 2 << 30)
    with pytest.raises(RefusedError, match="does not fit the memory"):
        build(mesh, tmp_path / "c.gsb")


def test_a_block_with_more_pieces_than_a_column_holds_is_refused(mesh, tmp_path, monkeypatch):
    monkeypatch.setattr(piece_buffer, "MOST_ITEMS", 20)
    with pytest.raises(RefusedError, match="source triangles, too many for its column"):
        build(mesh, tmp_path / "a.gsb")


@pytest.mark.parametrize("sep", ["6", "26", "conservative"])
def test_the_pieces_have_the_area_that_the_ledger_states(mesh, tmp_path, sep):
    path = build(mesh, tmp_path / "a.gsb", sep=sep)
    ledger, pieces = ledger_of(path), triangles_of(path)
    assert len(pieces) == ledger["pieces"]
    stated = ledger["area_total"] / 2**26
    assert areas(pieces).sum() / 2**24 == pytest.approx(stated, rel=1e-5)


@pytest.mark.parametrize("block", [8, 32])
def test_the_pieces_of_a_closed_mesh_close_up_in_the_file(tmp_path, block):
    mesh = write_ply(tmp_path / "s.ply", *sphere(20))
    path = build(mesh, tmp_path / "a.gsb", block=block)
    assert ledger_of(path)["pieces_left_out"] == 0
    edges = Counter()
    for corners in triangles_of(path).tolist():
        for p, q in zip(corners, corners[1:] + corners[:1], strict=True):
            edges[tuple(p), tuple(q)] += 1
    assert all(count == edges[q, p] for (p, q), count in edges.items())


def test_pieces_change_no_voxel_where_each_block_has_one_anyway(mesh, tmp_path):
    kept = block_file_content(build(mesh, tmp_path / "a.gsb", sep="conservative"))
    plain = build(mesh, tmp_path / "b.gsb", sep="conservative", keep_geometry=False)
    for with_pieces, without in zip(
        kept["levels"], block_file_content(plain)["levels"], strict=True
    ):
        for name in ("vertex", "triangle"):
            del with_pieces["columns"][name]
        assert with_pieces == without


def test_a_block_that_would_have_pieces_and_no_voxel_gets_the_voxels_that_they_touch(tmp_path):
    # The face x + y = 32.4 cuts off the low edges of blocks at (0, 32), (16, 16) and (32, 0): no
    # centre line of a voxel is met there.
    points = np.array([[0, 32.4, 0], [32.4, 0, 0], [32.4, 0, 40], [0, 32.4, 40]])
    mesh = write_ply(tmp_path / "w.ply", points, np.array([[0, 1, 2], [0, 2, 3]]))
    settings = {"resolution": None, "voxel_size": 1.0}
    kept = build(mesh, tmp_path / "a.gsb", **settings)
    plain = build(mesh, tmp_path / "b.gsb", keep_geometry=False, **settings)
    with gstream.open(kept) as file, gstream.open(plain) as without:
        assert without.block(0, (1, 1, 1)) is None
        positions = file.block(0, (1, 1, 1)).positions()
        assert set(map(tuple, positions.tolist())) == {(16, 16, z) for z in range(16, 32)}
    pruned = [ledger_of(path)["area_pruned"] for path in (kept, plain)]
    strip = 0.4 * 2**0.5 * 40 * 2**26  # of the face, in a column of blocks that had no voxel
    assert pruned[1] - pruned[0] == pytest.approx(3 * strip, rel=1e-3)


def test_what_rounding_moves_into_a_block_without_voxels_is_left_out_and_counted(tmp_path):
    # A needle, and points that lay the grid: at half voxels one piece is rounded into block
    # (3, 4, 5), which the needle does not touch.
    needle = [[13, 84, 62], [121, 25, 113], [66, 56, 87]]
    points = np.array([*needle, *[[0, 0, 0]] * 3, *[[127, 127, 127]] * 3]) / 2
    mesh = write_ply(tmp_path / "n.ply", points, np.arange(9).reshape(3, 3))
    path = build(mesh, tmp_path / "a.gsb", resolution=None, voxel_size=1.0, block=8, snap_bits=1)
    ledger = ledger_of(path)
    every = sum(piece_oracle.pieces([tuple(p) for p in needle], 16).values())
    assert (ledger["pieces"], ledger["pieces_left_out"]) == (every - 1, 1)
    assert gstream.check(path).ok


def test_levels_made_anew_keep_the_pieces(mesh, tmp_path):
    from gstream.run import commands

    path = build(mesh, tmp_path / "a.gsb", keep_weights=True)
    fine = build(mesh, tmp_path / "f.gsb", lod=False)
    again = commands.simplify(str(fine), str(tmp_path / "b.gsb"), commands.RunOptions(workers=0))
    again.run(None)
    assert (tmp_path / "b.gsb").read_bytes() == path.read_bytes()


def test_a_fresh_file_is_valid_and_the_reference_decoder_reads_the_same_pieces(mesh, tmp_path):
    path = build(mesh, tmp_path / "a.gsb")
    assert gstream.check(path).ok
    levels = runpy.run_path(str(DECODER))["summary"](path.read_bytes())["levels"]
    mine = {level["level"]: level["columns"] for level in block_file_content(path)["levels"]}
    for level in levels:
        hashes = {name: digest.hexdigest() for name, digest in level["columns"].items()}
        assert hashes == mine[level["level"]]
