"""What a viewer sees at first, without OpenGL: cameras, the default scene, facts of a file."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_block_files import file_bytes, random_scene

from gstream_tools.reader_py import BlockFile, open_source
from gstream_tools.scene import Facts, SceneError, resolve, scene_of
from gstream_tools.view_gl.camera import View
from gstream_tools.view_gl.session import (
    Session,
    UsageError,
    Wishes,
    camera_of_text,
    constant_colour,
    default_scene,
    facts_of,
    refit,
    scene_camera,
)

UNIT = np.hstack((np.eye(3), np.zeros((3, 1))))
coordinates = st.floats(-100, 100)
boxes = st.tuples(*[coordinates] * 3, *[st.floats(0.01, 100)] * 3).map(
    lambda row: np.array([row[:3], np.add(row[:3], row[3:])])
)


def file_of(box=((-1, -2, -3), (1, 2, 3)), up=None, names=("normal",)):
    return SimpleNamespace(
        box=np.array(box, float),
        metadata={} if up is None else {"up": up},
        columns=dict(enumerate(names)),
        source=SimpleNamespace(name="a.gsb"),
    )


def camera_of(file=None, aspect=1.0, **camera):
    return scene_camera(scene_of({"camera": camera}), file or file_of(), aspect)


def sight(camera):
    """The unit vector from the eye to the target."""
    way = np.subtract(camera.target, camera.position)
    return way / np.linalg.norm(way)


def on_screen(camera, box, aspect):
    """(8, 2) the box's corners, -1 to 1 within the picture."""
    view = View.of(camera, (round(300 * aspect), 300), UNIT, box)
    corners = box[[[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], [0, 1, 2]]
    clip = np.hstack((corners, np.ones((8, 1)))) @ view.clip.T
    assert (clip[:, 3] > 0).all()
    return clip[:, :2] / clip[:, 3:]


@pytest.mark.parametrize(
    ("up", "azimuth", "way"),
    [
        (None, 0, (0, 1, 0)),  # spec/scene.md 2.3: in front of an object with up axis z, along +y
        ("z", 90, (-1, 0, 0)),
        ("y", 0, (0, 0, -1)),
        ("Y", 90, (-1, 0, 0)),
        ("+z", 180, (0, -1, 0)),
        ("nonsense", 0, (0, 1, 0)),
    ],
)
def test_a_fitted_camera_looks_where_the_spec_says(up, azimuth, way):
    camera = camera_of(file_of(up=up), azimuth=azimuth, elevation=0)
    np.testing.assert_allclose(sight(camera), way, atol=1e-12)


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_file_s_up_axis_is_upright_and_elevation_is_above_it(up):
    axis = np.eye(3)["xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    camera = camera_of(file_of(up=up), azimuth=20, elevation=30)
    assert camera.axes()[1] @ axis == pytest.approx(np.cos(np.radians(30)))
    assert sight(camera) @ axis == pytest.approx(-0.5)


@pytest.mark.parametrize("elevation", [-90, 90])
def test_from_the_poles_the_picture_is_turned_as_from_beside_them(elevation):
    pole = camera_of(azimuth=40, elevation=elevation).axes()
    beside = camera_of(azimuth=40, elevation=elevation * 0.999).axes()
    np.testing.assert_allclose(pole, beside, atol=2e-3)


@given(boxes, st.floats(0.3, 3), st.integers(0, 359), st.integers(-90, 90), st.booleans())
def test_a_fitted_box_fills_the_picture_with_at_most_a_tenth_to_spare(
    box, aspect, azimuth, elevation, parallel
):
    projection = "orthographic" if parallel else "perspective"
    aspect = round(300 * aspect) / 300
    camera = camera_of(
        file_of(box), aspect, azimuth=azimuth, elevation=elevation, projection=projection
    )
    assert 1 / 1.1 <= np.abs(on_screen(camera, box, aspect)).max() <= 1


@given(boxes, st.integers(0, 359), st.integers(-80, 80), st.booleans())
def test_fitting_again_from_anywhere_changes_the_place_but_not_the_direction(
    box, azimuth, elevation, parallel
):
    projection = "orthographic" if parallel else "perspective"
    first = camera_of(file_of(box), azimuth=azimuth, elevation=elevation, projection=projection)
    found = refit(first.zoom(7).move(3, 2, 1), box, 1.0)
    np.testing.assert_allclose(sight(found), sight(first), atol=1e-9)
    assert np.abs(on_screen(found, box, 1.0)).max() == pytest.approx(
        np.abs(on_screen(first, box, 1.0)).max()
    )


def test_a_scene_places_its_camera():
    camera = camera_of(position=[9, 0, 0], target=[0, 1, 0], up=[0, 1, 0], fov=20)
    assert (camera.position, camera.target) == ((9, 0, 0), (0, 1, 0))
    assert (camera.up, camera.fov, camera.height) == ((0, 1, 0), 20, 0)


def test_a_target_moves_a_fitted_camera_with_it():
    plain, moved = camera_of(), camera_of(target=[5, 5, 5])
    np.testing.assert_allclose(sight(moved), sight(plain))
    assert moved.target == (5, 5, 5)


@pytest.mark.parametrize("where", [{"position": [0, 0, 0]}, {"position": [0, 0, 7]}])
def test_a_camera_that_looks_nowhere_or_along_its_up_is_refused(where):
    with pytest.raises(SceneError, match=r"camera\.position"):
        camera_of(**where)


def test_a_text_s_camera_is_the_scene_s():
    scene, file = scene_of({"camera": {"azimuth": 7, "fov": 50}}), file_of()
    fitted = camera_of_text("fit:30,-20,2", scene, file, 1.0)
    assert fitted == camera_of(azimuth=30, elevation=-20, fov=50).zoom(2)
    placed = camera_of_text("1,2,3:-4,5,6", scene, file, 1.0)
    assert placed == camera_of(position=[1, 2, 3], target=[-4, 5, 6], fov=50)
    assert camera_of_text("1,2,3:-4,5,6:70", scene, file, 1.0).fov == 70


@pytest.mark.parametrize("text", [
    "", "fit", "fit:", "fit:1", "fit:1,2,3,4", "fit:1,91", "fit:1,2,0", "fit:1,2:3", "1,2,3", "a",
    "1,2,3:4,5", "1,2,3:4,5,6:", "1,2,3:4,5,6:0", "1,2,3:4,5,6:7:8", "fit:1,2,3:4,5,6",
    "inf,2,3:4,5,6",
])  # fmt: skip
def test_other_texts_are_no_camera(text):
    with pytest.raises(UsageError, match=r"is not understood; give fit:AZIMUTH"):
        camera_of_text(text, scene_of({}), file_of(), 1.0)


@given(st.integers(0, 359), st.integers(-60, 60))
def test_the_default_lamp_shines_from_behind_the_viewer_s_left_shoulder(azimuth, elevation):
    camera = camera_of(azimuth=azimuth, elevation=elevation)
    (light,) = default_scene(file_of(), camera).lights
    right, above, back = camera.axes() @ np.negative(light.direction)
    assert right < -0.3
    assert above > 0.3
    assert back > 0.3


def test_a_file_without_normals_is_shown_flat():
    scene = default_scene(file_of(names=()), camera_of())
    facts = Facts(columns=frozenset({"occupancy", "mask"}))
    assert resolve(scene, facts).columns == ("occupancy", "mask")


COLOUR = 0x80FF7F10  # packed: R in the lowest byte


def opened(tmp_path, change=lambda colours: colours, names=("occupancy", "mask", "colour")):
    """A file of several blocks; change : of the colours, (n, 4), of each."""
    scene = random_scene(names=names)
    for block in scene.blocks.values():
        block.colour[:] = change(block.colour)
    (tmp_path / "a.gsb").write_bytes(file_bytes(scene))
    return BlockFile(open_source(str(tmp_path / "a.gsb")))


def all_but_one():
    """A change to COLOUR that leaves out one voxel, of one block."""
    blocks = iter([1])

    def change(colours):
        found = np.full((len(colours), 4), np.frombuffer(COLOUR.to_bytes(4, "little"), np.uint8))
        found[0, 0] += next(blocks, 0)
        return found

    return change


def test_a_colour_that_all_voxels_have_is_a_fact(tmp_path):
    with opened(tmp_path, lambda _: np.frombuffer(COLOUR.to_bytes(4, "little"), np.uint8)) as file:
        assert constant_colour(file) == COLOUR
        assert facts_of(file).constant_colour


@pytest.mark.parametrize("change", [lambda colours: colours, all_but_one()], ids=["random", "one"])
def test_a_colour_that_one_voxel_has_not_is_no_constant(tmp_path, change):
    with opened(tmp_path, change) as file:
        assert constant_colour(file) is None
        assert not facts_of(file).constant_colour


def test_each_block_of_another_constant_is_no_constant(tmp_path):
    shades = iter(range(10_000))
    with opened(tmp_path, lambda colours: np.full((len(colours), 4), next(shades) % 256)) as file:
        assert constant_colour(file) is None


def test_the_facts_are_the_head_s(tmp_path):
    with opened(tmp_path, names=("occupancy", "mask", "weight")) as file:
        found = facts_of(file)
    assert found.columns == {"occupancy", "mask", "weight"}
    assert (found.levels, found.blocks) == (file.levels, file.blocks)
    assert (found.voxels, found.constant_colour) == (sum(file.level_voxels), False)


def test_a_constant_colour_is_the_surface_s_unless_the_scene_shows_none(tmp_path):
    opened(tmp_path, lambda _: np.frombuffer(COLOUR.to_bytes(4, "little"), np.uint8)).close()
    (tmp_path / "none.toml").write_text('[source]\ncolours = "none"\n')
    plain = Session.open(str(tmp_path / "a.gsb"), Wishes(), 1.0)
    none = Session.open(str(tmp_path / "a.gsb"), Wishes(scene=str(tmp_path / "none.toml")), 1.0)
    assert plain.scene.shade.colour == (0x10 / 255, 0x7F / 255, 1.0)
    assert none.scene.shade.colour == (0.8, 0.8, 0.8)
    for session in (plain, none):
        session.file.close()
