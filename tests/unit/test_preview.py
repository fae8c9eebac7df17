"""The picture of a block file: cubes against a slow twin, the camera, the PNG, what is refused."""

import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from small_block_files import IDENTITY, Scene, coarser, file_bytes, random_scene

from gstream.errors import CorruptFileError, GstreamError, UsageError
from gstream.formats.blockhead import BlockFileHeader
from gstream.formats.columns import Block
from gstream.formats.lodrule import encode_normals
from gstream.formats.morton import encode_morton
from gstream.formats.png import png
from gstream.kernels import splat
from gstream.preview import UP, Camera, Picture, fit_camera, parse_view, render

MATRIX = np.array(IDENTITY).reshape(3, 4)
SMALL = (48, 32)


def scene_of(
    places: NDArray[np.int64],
    normals: NDArray[np.int64] | None = None,
    colour: tuple[int, ...] = (200, 30, 30, 255),
    resolution: int = 16,
    names: tuple[str, ...] = ("occupancy", "mask", "normal", "colour"),
) -> Scene:
    """Voxels at `places` in blocks of 8^3, with all levels."""
    codes = encode_morton(places)
    order = np.argsort(codes)
    count = len(codes)
    directions = np.tile([0, -1000, 0], (count, 1)) if normals is None else normals
    encoded = encode_normals(directions[order].astype(np.int64), 11)
    levels = 1 + (-(-resolution // 8) - 1).bit_length()
    header = BlockFileHeader(
        resolution, 12, levels, 3, IDENTITY, (0.0,) * 3 + (float(resolution),) * 3
    )
    scene, blocks = Scene(header, {}, names), {}
    owner = codes[order] >> np.uint64(9)
    for key in np.unique(owner):
        here = owner == key
        n = int(here.sum())
        blocks[int(key)] = Block(
            (codes[order][here] & np.uint64(511)).astype(np.uint32),
            np.full(n, 63, np.uint8),
            encoded[here],
            np.tile(np.array(colour, np.uint8), (n, 1)),
            np.full(n, 1 << 20, np.uint32),
        )
    for level in range(levels):
        scene.blocks.update({(level, key): block for key, block in blocks.items()})
        blocks = coarser(blocks, 3, 11, area=True)
    return scene


def shell(edge: int, low: int = 2) -> NDArray[np.int64]:
    """The surface voxels of a cube of edge^3 voxels."""
    places = np.indices((edge,) * 3).reshape(3, -1).T
    outside = ((places == 0) | (places == edge - 1)).any(axis=1)
    return places[outside] + low


def written(scene: Scene, path: Path, **more: str) -> Path:
    path.write_bytes(file_bytes(scene, meta=dict(more)))
    return path


def camera_for(places: NDArray[np.int64], view: str = "three-quarter", up: str = "z") -> Camera:
    boxes = places.astype(np.float64)
    return fit_camera(boxes, boxes + 1, MATRIX, UP[up], parse_view(view), SMALL)


def naive_depth(camera: Camera, low: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth at which each pixel's ray enters the voxel at `low`, inf where it misses, (h, w)."""
    eye, ray = camera.numbers[12:15], camera.numbers[15:24].reshape(3, 3)
    y, x = np.indices(SMALL[::-1]) + 0.5
    way = np.stack([x, y, np.ones_like(x)], axis=-1) @ ray.T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort([(low - eye) / way, (low + 1 - eye) / way], axis=0)
    # a ray along a slab is in it from always to ever, or never
    along, within = way == 0, (low <= eye) & (eye <= low + 1)
    enter = np.where(along, np.where(within, 0, np.inf), ends[0]).max(axis=-1).clip(0)
    leave = np.where(along, np.where(within, np.inf, 0), ends[1]).min(axis=-1)
    return np.where(enter <= leave, enter, np.inf)


def drawn(camera: Camera, places: NDArray[np.int64], colours: NDArray[np.uint8]) -> Picture:
    picture = Picture.blank(*SMALL)
    normals = np.tile(np.float32([0, -1, 0]), (len(places), 1))
    splat.splat(
        camera.numbers, places, 1, normals, colours, picture.depth, picture.normal, picture.colour
    )
    return picture


views = st.tuples(st.floats(-180, 180), st.floats(-90, 90)).map(lambda v: f"{v[0]},{v[1]}")
voxels = st.lists(st.tuples(*[st.integers(0, 7)] * 3), min_size=1, max_size=12, unique=True)


@given(voxels, views)
def test_every_pixel_shows_the_voxel_that_its_ray_enters_first(
    chosen: list[tuple[int, int, int]], view: str
) -> None:
    places = np.array(chosen, np.int64)
    camera = camera_for(places, view)
    picture = drawn(camera, places, np.empty((0, 3), np.uint8))
    first = np.min([naive_depth(camera, place) for place in places.astype(np.float64)], axis=0)
    # a ray that grazes an edge may hit for one rounding and miss for another
    assert np.isclose(picture.depth, first, rtol=1e-6, atol=0).mean() > 0.999


@given(voxels, views)
def test_the_footprint_holds_every_pixel_whose_ray_hits_the_box(
    chosen: list[tuple[int, int, int]], view: str
) -> None:
    places = np.array(chosen, np.int64)
    camera = camera_for(places, view)
    low, high = places[0].astype(np.float64), places[0] + 1.0
    x0, x1, y0, y1, near = splat.footprint(camera.numbers, low, high)
    depth = naive_depth(camera, low)
    assert depth.min() >= near * (1 - 1e-12)
    depth[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = np.inf
    assert np.isinf(depth).all()


def test_a_box_behind_the_eye_is_never_called_hidden() -> None:
    camera = camera_for(shell(4))
    depth = np.full((32, 48), np.inf, np.float32)
    eye = camera.numbers[12:15]
    assert not splat.is_hidden(depth, camera.numbers, eye - 1, eye + 1)
    assert splat.is_hidden(np.zeros_like(depth), camera.numbers, eye - 1, eye + 1)


def test_a_closed_surface_shows_no_background_inside_its_outline() -> None:
    places = shell(9)
    picture = drawn(camera_for(places), places, np.empty((0, 3), np.uint8))
    for row in np.isfinite(picture.depth):
        inside = np.flatnonzero(row)
        assert len(inside) == 0 or inside[-1] - inside[0] + 1 == len(inside)


@given(voxels, views, st.sampled_from(["y", "z"]))
def test_the_camera_shows_all_boxes_and_wastes_no_room(
    chosen: list[tuple[int, int, int]], view: str, up: str
) -> None:
    places = np.array(chosen, np.float64)
    camera = camera_for(places.astype(np.int64), view, up)
    corners = (places[:, None] + np.indices((2, 2, 2)).reshape(3, 8).T).reshape(-1, 3)
    seen = camera.numbers[:12].reshape(3, 4) @ np.column_stack([corners, np.ones(len(corners))]).T
    assert (seen[2] > 0).all()
    reach = np.abs(seen[:2] / seen[2]).max(axis=1) / (np.array(SMALL) / 2)
    assert 0.85 < reach.max() <= 0.93


def test_a_file_with_y_up_looks_like_the_same_file_turned_to_z_up(tmp_path: Path) -> None:
    low = np.unique(np.random.default_rng(3).integers(0, 16, (60, 3)), axis=0)
    turned = np.stack([low[:, 0], low[:, 2], 15 - low[:, 1]], axis=1)  # z up -> y up
    z_up, y_up = written(scene_of(low), tmp_path / "z.gsb", up="z"), tmp_path / "y.gsb"
    written(scene_of(turned, np.tile([0, 0, 1000], (len(low), 1))), y_up, up="y")
    render(z_up, tmp_path / "z.png", SMALL)
    render(y_up, tmp_path / "y.png", SMALL)
    one, two = (decoded((tmp_path / name).read_bytes()) for name in ("z.png", "y.png"))
    # rays are equal but for rounding, which may move a pixel on the border of two voxels
    assert (np.abs(one.astype(int) - two) > 2).any(axis=2).mean() < 0.02


def test_the_up_axis_asked_for_beats_the_file_s(tmp_path: Path) -> None:
    path = written(random_file(), tmp_path / "a.gsb", up="y")
    render(path, tmp_path / "as-said.png", SMALL)
    render(path, tmp_path / "y.png", SMALL, up="y")
    render(path, tmp_path / "z.png", SMALL, up="z")
    said, y, z = ((tmp_path / f"{n}.png").read_bytes() for n in ("as-said", "y", "z"))
    assert said == y != z


def random_file(**settings: int) -> Scene:
    return random_scene(**settings)


def test_skipping_hidden_blocks_changes_no_pixel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(scene_of(shell(26), resolution=32), tmp_path / "a.gsb")
    info = render(path, tmp_path / "a.png", SMALL, level=0)
    monkeypatch.setattr(splat, "is_hidden", lambda *_: False)
    whole = render(path, tmp_path / "b.png", SMALL, level=0)
    assert info.blocks_read < info.blocks == whole.blocks_read
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_the_level_drawn_is_the_coarsest_whose_voxel_fits_a_pixel(tmp_path: Path) -> None:
    path = written(scene_of(shell(60), resolution=64), tmp_path / "a.gsb")
    levels = [render(path, tmp_path / "a.png", (s, s)).level for s in (400, 40, 20, 1)]
    assert levels == [0, 1, 2, 3]


def test_a_picture_reads_no_block_of_another_level(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from gstream import read

    path = written(scene_of(shell(60), resolution=64), tmp_path / "a.gsb")
    levels, stored = set(), read.BlockView._stored

    def spy(block: read.BlockView, name: str) -> bytes:
        levels.add((block.level, name))
        return stored(block, name)

    monkeypatch.setattr(read.BlockView, "_stored", spy)
    level = render(path, tmp_path / "a.png", (50, 50)).level
    assert levels == {(level, name) for name in ("occupancy", "normal", "colour")}


def test_voxel_colours_are_shown_and_clay_stands_in_for_none(tmp_path: Path) -> None:
    red = written(scene_of(shell(9)), tmp_path / "red.gsb")
    bare = scene_of(shell(9), names=("occupancy", "mask", "normal"))
    clay = written(bare, tmp_path / "clay.gsb")
    middle = []
    for path in (red, clay):
        render(path, tmp_path / "a.png", SMALL, "front")
        middle.append(decoded((tmp_path / "a.png").read_bytes())[16, 24].astype(int))
    assert middle[0][0] > 2 * middle[0][1]
    assert np.ptp(middle[1]) < 60
    assert middle[1].min() > 90


def test_voxels_without_a_direction_are_lit_flat(tmp_path: Path) -> None:
    places = shell(9)
    scene = scene_of(places, np.zeros((len(places), 3), np.int64))
    render(written(scene, tmp_path / "a.gsb"), tmp_path / "a.png", SMALL, "front")
    rgb = decoded((tmp_path / "a.png").read_bytes())
    assert np.ptp(rgb[10:22, 20:28].astype(int), axis=(0, 1)).max() <= 40
    assert rgb[16, 24, 0] > 80


def test_without_normals_the_faces_of_a_voxel_tell_where_it_looks(tmp_path: Path) -> None:
    scene = scene_of(shell(9), np.tile([0, -1000, -1000], (len(shell(9)), 1)))
    for block in scene.blocks.values():
        block.mask = np.full(block.count, 0b010100, np.uint8)  # -y and -z: as its normals say
    render(written(scene, tmp_path / "a.gsb"), tmp_path / "normals.png", SMALL)
    bare = replace(scene, names=("occupancy", "mask", "colour"))
    render(written(bare, tmp_path / "a.gsb"), tmp_path / "masks.png", SMALL)
    normals, masks = (tmp_path / f"{name}.png" for name in ("normals", "masks"))
    two = decoded(normals.read_bytes()).astype(int), decoded(masks.read_bytes()).astype(int)
    assert np.abs(two[0] - two[1]).max() <= 1  # codes of normals are rounded


def test_a_file_of_places_alone_is_drawn(tmp_path: Path) -> None:
    scene = scene_of(shell(9), names=("occupancy",))
    assert render(written(scene, tmp_path / "a.gsb"), tmp_path / "a.png", SMALL).voxels > 0


def test_the_same_file_gives_the_same_picture(tmp_path: Path) -> None:
    path = written(random_file(), tmp_path / "a.gsb")
    for name in ("a.png", "b.png"):
        render(path, tmp_path / name, SMALL)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize(
    ("size", "view", "level"),
    [
        ((0, 10), "front", None),
        ((10, 1 << 20), "front", None),
        ((16_384, 16_384), "front", None),
        (SMALL, "sideways", None),
        (SMALL, "10", None),
        (SMALL, "10,20,30", None),
        (SMALL, "nan,0", None),
        (SMALL, "0,91", None),
        (SMALL, "front", 3),
        (SMALL, "front", -1),
    ],
)
def test_a_request_that_makes_no_sense_is_one_line_and_no_file(
    tmp_path: Path, size: tuple[int, int], view: str, level: int | None
) -> None:
    path = written(random_file(), tmp_path / "a.gsb")
    with pytest.raises(UsageError) as refused:
        render(path, tmp_path / "a.png", size, view, level)
    assert "\n" not in str(refused.value)
    assert [p.name for p in tmp_path.iterdir()] == ["a.gsb"]


def test_a_damaged_file_is_refused_and_leaves_no_picture(tmp_path: Path) -> None:
    path = written(random_file(), tmp_path / "a.gsb")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data[:-100])
    with pytest.raises(CorruptFileError):
        render(path, tmp_path / "a.png", SMALL)
    with pytest.raises(GstreamError):
        render(tmp_path / "missing.gsb", tmp_path / "a.png", SMALL)
    assert [p.name for p in tmp_path.iterdir()] == ["a.gsb"]


@pytest.mark.parametrize("view", ["front", "right", "back", "left", "top", "bottom"])
def test_each_named_view_looks_along_its_axis(view: str) -> None:
    axis, side = {
        "front": (1, -1),
        "right": (0, 1),
        "back": (1, 1),
        "left": (0, -1),
        "top": (2, 1),
        "bottom": (2, -1),
    }[view]
    places = shell(9)
    eye = camera_for(places, view).numbers[12:15] - (places.min() + 4.5)
    assert eye[axis] * side > 9
    assert np.abs(np.delete(eye, axis)).max() < 1


def decoded(data: bytes) -> NDArray[np.uint8]:
    """An independent, slow reader of 8-bit RGB PNG files: (h, w, 3)."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, parts = 8, {}
    while at < len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        body, crc = data[at + 8 : at + 8 + length], data[at + 8 + length : at + 12 + length]
        assert int.from_bytes(crc, "big") == zlib.crc32(kind + body)
        parts[kind] = body
        at += 12 + length
    assert list(parts) == [b"IHDR", b"sRGB", b"IDAT", b"IEND"]
    width, height = (int.from_bytes(parts[b"IHDR"][i : i + 4], "big") for i in (0, 4))
    lines = zlib.decompress(parts[b"IDAT"])
    step = 1 + 3 * width
    assert len(lines) == height * step
    above, rows = bytes(3 * width), []
    for y in range(height):
        kind, row = lines[y * step], bytearray(lines[y * step + 1 : (y + 1) * step])
        for i in range(3 * width):
            a, b = row[i - 3] if i >= 3 else 0, above[i]
            c = above[i - 3] if i >= 3 else 0
            nearest = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))
            row[i] = (row[i] + (0, a, b, (a + b) // 2, nearest[2])[kind]) % 256
        rows.append(bytes(row))
        above = rows[-1]
    return np.frombuffer(b"".join(rows), np.uint8).reshape(height, width, 3)


@given(st.integers(1, 70), st.integers(1, 9), st.integers(0, 1 << 30), st.booleans())
def test_a_png_decodes_to_its_pixels(height: int, width: int, seed: int, smooth: bool) -> None:
    rng = np.random.default_rng(seed)
    rgb = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    if smooth:
        rgb = (np.cumsum(rgb % 5, axis=0) + np.cumsum(rgb % 3, axis=1)).astype(np.uint8)
    np.testing.assert_array_equal(decoded(png(rgb)), rgb)
