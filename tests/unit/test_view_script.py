"""Camera scripts without OpenGL: the spline, the key frames, and what is refused."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream_tools.scene import SceneError, scene_of
from gstream_tools.view_gl.script import ScriptError, curve, read_script, script_of

PLACE = {"position": [0, -10, 0], "target": [0, 0, 0]}
SESSION = SimpleNamespace(  # what a camera needs of one: the scene, and the file's box
    scene=scene_of({}),
    file=SimpleNamespace(box=np.array([[-1.0, -1, -1], [1, 1, 1]]), metadata={}),
)
numbers = st.floats(-1e3, 1e3)
tracks = st.lists(st.tuples(st.floats(0.01, 10), numbers, numbers), min_size=1, max_size=6).map(
    lambda rows: (np.cumsum([row[0] for row in rows]), np.array([row[1:] for row in rows]))
)


def cameras(script, aspect=1.0):
    return [script.camera(frame, SESSION, aspect) for frame in range(script.frames)]


@given(tracks)
def test_a_curve_goes_through_its_keys(track):
    times, rows = track
    found = [curve(times, rows, time) for time in times]
    np.testing.assert_allclose(found, rows, rtol=0, atol=1e-9)


@given(tracks, numbers)
def test_a_straight_track_is_followed_at_its_own_pace(track, slope):
    times, _ = track
    rows = (slope * times)[:, None]
    for time in np.linspace(times[0], times[-1], 7):
        assert curve(times, rows, time)[0] == pytest.approx(slope * time, rel=1e-9, abs=1e-6)


@given(tracks)
def test_a_curve_has_no_corner_at_a_key(track):
    times, rows = track
    for time in times[1:-1]:
        step = 1e-6 * np.diff(times).min()
        before = (curve(times, rows, time) - curve(times, rows, time - step)) / step
        after = (curve(times, rows, time + step) - curve(times, rows, time)) / step
        largest = np.abs(np.diff(rows, axis=0) / np.diff(times)[:, None]).max()
        np.testing.assert_allclose(before, after, rtol=0, atol=1e-3 * largest + 1e-3)


def test_what_two_keys_agree_on_rests_between_them():
    times = np.array([0.0, 1, 2, 5])
    rows = np.array([[0.0], [7], [7], [100]])
    assert {curve(times, rows, time)[0] for time in np.linspace(1, 2, 9)} == {7.0}


def test_frozen_values_of_an_uneven_curve():
    # By hand: slopes 2 and -1, so the middle key's tangent is (2 * 2 - 1 * 1) / 3 = 1, and halfway
    # there are (0 + 2) / 2 + (2 - 1) / 8, and (2 + 0) / 2 + 2 (1 + 1) / 8.
    times, rows = np.array([0.0, 1, 3]), np.array([[0.0], [2], [0]])
    assert curve(times, rows, 0.5)[0] == 1.125
    assert curve(times, rows, 2.0)[0] == 1.5


def test_there_is_a_frame_at_both_ends():
    script = script_of({"fps": 10, "keys": [{"time": 2, **PLACE}, {"time": 3, **PLACE}]})
    assert script.frames == 11


def test_a_single_key_is_one_picture():
    script = script_of({"keys": [{"time": 0, **PLACE}]})
    (camera,) = cameras(script)
    assert (camera.position, camera.target) == ((0, -10, 0), (0, 0, 0))


def test_an_orbit_keeps_its_distance_and_turns_evenly():
    keys = [{"time": t, "azimuth": a, "elevation": 20} for t, a in ((0, 0), (4, 360))]
    found = cameras(script_of({"fps": 2, "keys": keys}))
    places = np.array([camera.position for camera in found])
    np.testing.assert_allclose(places[0], places[-1], atol=1e-9)
    angles = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    np.testing.assert_allclose(np.diff(angles), np.pi / 4)


def test_an_orbit_from_the_front_goes_to_the_right():
    found = cameras(script_of({"fps": 1, "keys": [
        {"time": 0, "azimuth": 0, "elevation": 0}, {"time": 1, "azimuth": 90, "elevation": 0},
    ]}))  # fmt: skip
    front, right = (np.array(camera.position) for camera in found)
    assert front[1] < -1
    assert right[0] > 1
    np.testing.assert_allclose([front[[0, 2]], right[[1, 2]]], 0, atol=1e-9)


def test_a_zoom_is_as_fast_near_as_far():
    keys = [{"time": t, "azimuth": 0, "zoom": z} for t, z in ((0, 1), (2, 4))]
    found = cameras(script_of({"fps": 1, "keys": keys}))
    far, middle, near = (np.linalg.norm(camera.position) for camera in found)
    assert far / middle == pytest.approx(2)
    assert middle / near == pytest.approx(2)


def test_a_script_may_change_the_angle_of_view():
    found = cameras(script_of({"fps": 1, "keys": [
        {"time": 0, **PLACE, "fov": 30}, {"time": 2, **PLACE, "fov": 60},
    ]}))  # fmt: skip
    assert [camera.fov for camera in found] == [30, 45, 60]


def test_a_camera_in_its_target_is_refused():
    script = script_of({"keys": [{"time": 0, "position": [1, 1, 1], "target": [1, 1, 1]}]})
    with pytest.raises(SceneError, match=r"camera\.position: is the target"):
        cameras(script)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "the script: is no object"),
        ({"keys": []}, "keys: is no list of key frames"),
        ({"keys": 3}, "keys: is no list of key frames"),
        ({"key": [], "keys": [{}]}, "the script: has no 'key'"),
        ({"fps": 0, "keys": [{"time": 0, **PLACE}]}, "fps: is not from 0.001 to 1000"),
        ({"fps": "9", "keys": [{"time": 0, **PLACE}]}, "fps: is not a number"),
        ({"keys": [7]}, r"keys\[0\]: is no object"),
        ({"keys": [{"time": 0}]}, r"keys\[0\]: needs either position or azimuth"),
        ({"keys": [{"time": 0, "azimuth": 1, **PLACE}]}, r"keys\[0\]: needs either"),
        ({"keys": [{"time": 0, "azimuth": 1, "target": [0, 0, 0]}]}, r"keys\[0\]: has no 'target'"),
        ({"keys": [{"azimuth": 1}]}, r"keys\[0\].time: is missing"),
        ({"keys": [{"time": 0, "azimuth": True}]}, r"keys\[0\].azimuth: is not a number"),
        ({"keys": [{"time": 0, "azimuth": 0, "elevation": 91}]}, r"keys\[0\].elevation: is not"),
        ({"keys": [{"time": float("nan"), "azimuth": 0}]}, r"keys\[0\].time: is not from"),
        ({"keys": [{"time": 0, "position": [1, 2]}]}, r"keys\[0\].position: is not 3 numbers"),
        ({"keys": [{"time": 0, **PLACE}, {"azimuth": 0}]}, r"keys\[1\]: has no 'azimuth'"),
        ({"keys": [{"time": 0, "azimuth": 0}] * 2}, r"keys\[1\].time: is not"),
        ({"keys": [{"time": 0, "azimuth": 0}, {"time": 1e6, "azimuth": 1}]}, "keys: 30000001"),
    ],
)  # fmt: skip
def test_what_is_no_script_is_named_by_its_place(given, said):
    with pytest.raises(ScriptError, match=f"^{said}"):
        script_of(given)


def test_an_error_names_the_file(tmp_path):
    path = tmp_path / "s.json"
    path.write_text(json.dumps({"keys": []}))
    with pytest.raises(ScriptError, match=r"s\.json: keys: "):
        read_script(path)
    path.write_text("{")
    with pytest.raises(ScriptError, match=r"s\.json: is no JSON"):
        read_script(path)
