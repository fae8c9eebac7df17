"""Hard cases of the voxelizer that the other exact tests leave open; each names its row."""

from random import Random

import numpy as np
import pytest
from exact import oracle, scenes
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import gstream
from gstream.kernels.voxelize import Voxels, voxelize_triangles
from gstream.read import BlockFile

GRIDS = ((16_384, 12), (65_536, 10))
EDGE = 8
EACH_MODE = [(sep, ties) for sep in oracle.SEPARATIONS for ties in oracle.TIES]
each_mode = pytest.mark.parametrize(("sep", "ties"), EACH_MODE)

grids = st.sampled_from(GRIDS)
modes = st.sampled_from(EACH_MODE)
seeds = st.integers(0, 2**32)


def as_set(rows: NDArray[np.int64]) -> set[tuple[int, int, int]]:
    return {(x, y, z) for x, y, z in rows.tolist()}


def set_in(found: Voxels, low: scenes.Vector, edge: int) -> NDArray[np.bool_]:
    return np.all((found.voxel >= low) & (found.voxel < np.array(low) + edge), axis=1)


def assert_exact(triangles, snap_bits: int, low: scenes.Vector, found: Voxels, sep: str, ties: str):
    """Voxels, targets, areas and masks of the window of EDGE^3 at low are the oracle's."""
    met: set[tuple[int, int, int]] = set()
    hits: set[tuple[int, int, int]] = set()
    areas: dict[tuple[int, int, int], float] = {}
    fragments: dict[tuple[int, int, int], int] = {}
    masks: dict[tuple[int, int, int], int] = {}
    for triangle in triangles:
        truth = oracle.voxels_of(triangle, snap_bits, low, EDGE, ties)
        shares = oracle.area_fractions(triangle, snap_bits, low, EDGE)
        met |= truth["conservative"]
        hits |= truth[sep]
        for voxel in truth["conservative"]:
            area = float(oracle.area_in_units(triangle, snap_bits, shares.get(voxel, 0)))
            areas[voxel] = areas.get(voxel, 0) + max(area, 1)
            fragments[voxel] = fragments.get(voxel, 0) + 1
            masks[voxel] = masks.get(voxel, 0) | oracle.face_mask(triangle)
    within = set_in(found, low, EDGE)
    where = (np.asarray(triangles).tolist(), snap_bits, low, sep, ties)
    assert as_set(found.voxel[within]) == met, where
    assert as_set(found.voxel[within & found.hit]) == hits, where
    rows = zip(found.voxel[within].tolist(), found.area[within], found.mask[within], strict=True)
    for row, area, mask in rows:
        voxel = tuple(row)
        assert abs(int(area) - areas[voxel]) <= fragments[voxel] + 1e-9 * areas[voxel], where
        assert mask == masks[voxel], where


@settings(max_examples=400)
@given(st.sampled_from(list(scenes.KINDS)), seeds, grids, modes)
def test_every_kind_is_exact_anywhere_in_the_largest_grids(kind, seed, grid, mode):
    """H-VX-2, H-VX-3, H-VX-4, H-VX-10, H-VX-11. Alone in a box of 8^3, up to its far corner."""
    resolution, snap_bits = grid
    random = Random(seed)
    low = tuple(random.choice([0, resolution - EDGE, random.randrange(resolution)]) for _ in "xyz")
    triangle = scenes.soup(kind, seed, 1, snap_bits, low, EDGE)
    found = voxelize_triangles(triangle, snap_bits, low, EDGE, *mode)
    assert_exact(triangle, snap_bits, low, found, *mode)


@settings(max_examples=100)
@given(st.sampled_from(scenes.SPANNING), seeds, grids, modes)
def test_triangles_as_large_as_the_scene_are_exact_in_any_window(kind, seed, grid, mode):
    """H-VX-10, H-VX-3, K-03, K-04. Also at slopes of 5e-7 and heights of one snap unit."""
    resolution, snap_bits = grid
    random = Random(seed)
    triangle = scenes.spanning(kind, seed, 1, resolution, snap_bits)
    spot = random.choice(scenes.places_on(triangle[0], random, snap_bits))
    low = tuple(c - random.randrange(EDGE) for c in spot)
    box_low = tuple(c - random.randrange(64 - EDGE + 1) for c in low)
    found = voxelize_triangles(triangle, snap_bits, box_low, 64, *mode)
    assert_exact(triangle, snap_bits, low, found, *mode)


@settings(max_examples=100)
@given(st.lists(st.sampled_from(list(scenes.KINDS)), min_size=1, max_size=4), seeds, modes)
def test_doubled_and_turned_triangles_add_area_and_faces_and_no_voxel(kinds, seed, mode):
    """H-VX-7, H-VX-16. A soup, some of it twice, some of it again facing the other way."""
    random = Random(seed)
    soup = np.concatenate([scenes.soup(kind, seed, 1, 7, (0, 0, 0), EDGE) for kind in kinds])
    again = [random.choice([t, t[::-1], np.roll(t, 1, axis=0)]) for t in soup]
    both = np.concatenate([soup, np.array(again)])
    found = voxelize_triangles(both, 7, (0, 0, 0), EDGE, *mode)
    assert_exact(both, 7, (0, 0, 0), found, *mode)
    once = voxelize_triangles(soup, 7, (0, 0, 0), EDGE, *mode)
    assert np.array_equal(found.voxel, once.voxel)
    assert np.array_equal(found.hit, once.hit)
    assert np.array_equal(found.area, 2 * once.area)


@pytest.mark.parametrize("ties", oracle.TIES)
def test_a_mode_6_voxel_is_crossed_itself_and_not_only_its_column(ties):
    """H-VX-12. Steep planes: a projection that covers a centre is above or below the voxel."""
    for rise in (2, 3, 7, 40):
        triangle = np.array([[[0, 0, 5], [64, 0, 64 * rise + 5], [0, 64, 5]]], np.int64)
        found = voxelize_triangles(triangle, 4, (0, 0, 0), EDGE, "6", ties)
        assert_exact(triangle, 4, (0, 0, 0), found, "6", ties)
        assert 0 < np.count_nonzero(found.hit) < len(found.voxel)


@each_mode
def test_twenty_thousand_triangles_in_a_voxel_sum_to_the_sum_of_each(sep, ties):
    """H-VX-5. A 10^-4th of a voxel across: points after snapping, one unit of area each."""
    rng = np.random.default_rng(5)
    tiny = np.array([[[20, 21, 22]]]) * 4096 + rng.integers(-1, 2, (20_000, 3, 3))
    found = voxelize_triangles(tiny, 12, (16, 16, 16), EDGE, sep, ties)
    total, vector = 0, np.zeros(3, np.int64)
    for part in np.array_split(tiny, 50):
        one = voxelize_triangles(part, 12, (16, 16, 16), EDGE, sep, ties)
        total, vector = total + int(one.area.sum()), vector + one.vector.sum(axis=0)
    assert int(found.area.sum()) == total >= 20_000
    assert np.array_equal(found.vector.sum(axis=0), vector)
    assert len(found.voxel) == 8
    turned = voxelize_triangles(np.roll(tiny[::-1], 1, 1), 12, (16, 16, 16), EDGE, sep, ties)
    for field in ("voxel", "hit", "area", "vector", "mask"):
        assert np.array_equal(getattr(found, field), getattr(turned, field)), field


def test_the_sums_of_100_000_full_faces_of_the_whitest_colour_do_not_overflow():
    """H-VX-5. Half a voxel's face each, 2^25 units times 65535: 2^58 in all."""
    face = np.array([[[0, 0, 2], [4, 0, 2], [0, 4, 2]]], np.int64)
    many, white = np.repeat(face, 100_000, axis=0), np.full((100_000, 3, 1), 65_535.0)
    found = voxelize_triangles(many, 2, (0, 0, 0), EDGE, "6", "one-sided", white)
    assert found.voxel[found.area > 100_000].tolist() == [[0, 0, 0]]
    largest = np.argmax(found.area)
    assert found.area[largest] == 100_000 << 25
    assert found.vector[largest, 2] == 100_000 << 37
    assert found.colour[largest, 0] == (100_000 << 25) * 65_535


@each_mode
@pytest.mark.parametrize("resolution", [256, 8192])
def test_splitting_a_planar_face_into_needles_changes_no_voxel(sep, ties, resolution):
    """H-VX-9, H-VX-3. Aspect up to 10^7; a needle costs its voxel at most a unit of area."""
    random, snap_bits = Random(resolution), 12
    unit, middle = 1 << snap_bits, resolution // 2
    mesh = scenes.octahedron((middle * unit + 7,) * 3, (middle - 3) * unit)
    parts = scenes.split(scenes.subdivided(mesh, 1), random)
    for triangle in mesh[::3]:
        for x, y, z in scenes.places_on(triangle, random, snap_bits):
            low = (x - 13, y - 21, z - 2)
            plain = voxelize_triangles(mesh, snap_bits, low, 32, sep, ties)
            fine = voxelize_triangles(parts, snap_bits, low, 32, sep, ties)
            assert plain.hit.any()
            for field in ("voxel", "hit", "mask"):
                assert np.array_equal(getattr(plain, field), getattr(fine, field)), field
            bound = 2 * len(parts) + 1e-9 * plain.area
            assert np.all(np.abs(plain.area - fine.area) <= bound)


def build(folder, points, triangles, **settings) -> BlockFile:
    """The block file of a mesh of decimals, which are written as they are."""
    mesh = folder / "mesh.obj"
    lines = [f"v {x!r} {y!r} {z!r}\n" for x, y, z in np.asarray(points, float).tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in np.asarray(triangles).tolist()]
    mesh.write_text("".join(lines))
    more = {"block": 16, "workers": 0, "force": True, **settings}
    gstream.build(mesh, folder / "out.gsb", **more)
    assert gstream.check(folder / "out.gsb").ok
    return gstream.open(folder / "out.gsb")


def finest(file: BlockFile) -> set[tuple[int, int, int]]:
    with file:
        return {tuple(v) for view in file.blocks(0) for v in view.positions().tolist()}


@pytest.mark.parametrize("ties", oracle.TIES)
def test_faces_at_both_ends_of_the_domain_are_one_voxel_thick_and_closed_ones_two(tmp_path, ties):
    """H-VX-1. Squares at x = 0 and x = 4, on the first and the last plane of a lattice of 1/4."""
    square = [(0, 0), (4, 0), (4, 4), (0, 4)]
    points = [(x, y, z) for x in (0, 4) for y, z in square]
    faces = [(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)]
    file = build(tmp_path, points, faces, voxel_size=0.25, sep="6", ties=ties)
    ledger, columns = file.metadata["ledger"], finest(file)
    assert ledger["outside"] == 0
    planes = {x for x, _, _ in columns}
    assert planes == ({0, 16} if ties == "one-sided" else {0, 15, 16})
    for x in planes:  # the rim's centres are half a voxel inside: 16 of each axis
        assert len([v for v in columns if v[0] == x]) == 16 * 16


def test_one_triangle_over_the_whole_domain_sets_the_voxels_of_its_thousand_parts(tmp_path):
    """H-VX-6. Whole it goes to every cell by the path of large triangles, its parts by the other.

    All corners are lattice points of the plane z = x, which passes along edges of voxels.
    """
    steps = 32
    points = [(i, j, i) for i in range(steps + 1) for j in range(steps + 1 - i)]
    at = {p[:2]: n for n, p in enumerate(points)}
    parts = [(at[i, j], at[i + 1, j], at[i, j + 1])
             for i in range(steps) for j in range(steps - i)]  # fmt: skip
    parts += [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1])
              for i in range(steps) for j in range(steps - 1 - i)]  # fmt: skip
    whole = [(at[0, 0], at[steps, 0], at[0, steps])]
    given = {"voxel_size": 1 / 8, "cell": 16, "sep": "conservative"}
    assert finest(build(tmp_path, points, whole, **given)) == finest(
        build(tmp_path, points, parts, **given)
    )


@pytest.mark.parametrize(("sep", "ties"), [("6", "one-sided"), ("26", "closed")])
def test_what_touches_the_borders_of_cells_is_counted_once_whatever_the_cell(tmp_path, sep, ties):
    """H-VX-13. Faces, edges and corners on multiples of 16 voxels, in cells of 16 and of one."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * 32.0
    hull = scenes.hull_of_cube([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
    box = [[int(4 * x + 2 * y + z) for x, y, z in face] for face in hull.tolist()]
    star = [[0, 0, 0], [64, 0, 0], [0, 64, 0], [0, 0, 64], [16, 16, 16], [48, 16, 0]]
    points = np.concatenate([corners + 16, star])
    faces = [*box, [9, 10, 11], [8, 12, 13], [12, 12, 12], [8, 9, 9]]
    files = set()
    for cell in (16, 64, 256):
        build(tmp_path, points, faces, voxel_size=1.0, sep=sep, ties=ties, cell=cell)
        files.add((tmp_path / "out.gsb").read_bytes())
    assert len(files) == 1
    with gstream.open(tmp_path / "out.gsb") as file:
        ledger = file.metadata["ledger"]
    area = 6 * 32 * 32 + 3**0.5 / 2 * 64**2 + area_of([0, 0, 0], [16, 16, 16], [48, 16, 0])
    slack = ledger["fragments"] / 2**26 + 1e-9 * area
    if ties == "one-sided":
        assert abs(ledger["area_total"] / 2**26 - area) <= slack


def area_of(*corners: list[int]) -> float:
    a, b, c = np.array(corners, float)
    return float(np.linalg.norm(np.cross(b - a, c - a))) / 2


def test_a_moebius_strip_and_three_sheets_at_one_edge_are_the_union_of_their_triangles():
    """H-VX-16. Neither closed nor orientable nor a manifold: no triangle asks another."""
    turn = np.linspace(0, 2 * np.pi, 13)
    radius = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    lean = radius * np.cos(turn / 2)[:, None] + [0, 0, 1] * np.sin(turn / 2)[:, None]
    rim = [np.round((32 + 20 * radius + way * 6 * lean) * 16).astype(int) for way in (-1, 1)]
    strip = [[rim[0][i], rim[0][i + 1], rim[1][i]] for i in range(12)]
    strip += [[rim[1][i], rim[0][i + 1], rim[1][i + 1]] for i in range(12)]
    sheets = [[[512, 512, 100], [512, 512, 900], end] for end in ([900, 512, 300], [100, 600, 400],
                                                                  [512, 100, 777])]  # fmt: skip
    mesh = np.concatenate([np.array(strip), np.array(sheets)]).astype(np.int64)
    for sep, ties in EACH_MODE:
        found = voxelize_triangles(mesh, 4, (0, 0, 0), 64, sep, ties)
        alone = [voxelize_triangles(t[None], 4, (0, 0, 0), 64, sep, ties) for t in mesh]
        assert as_set(found.voxel[found.hit]) == set().union(
            *(as_set(a.voxel[a.hit]) for a in alone)
        )
        assert found.area.sum() == sum(a.area.sum() for a in alone)
