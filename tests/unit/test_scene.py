"""gstream_tools.scene: scenes, and what they call for; the vectors are tests/conformance's."""

import re
from pathlib import Path

import pytest

from gstream_tools.scene import (
    Facts,
    RefusedSceneError,
    SceneError,
    explain,
    read_scene,
    resolve,
    scene_of,
)

SUN = {"direction": [-1, 0, -1]}
FACTS = Facts(frozenset({"occupancy", "mask", "normal", "colour"}), levels=3, blocks=9)


def test_an_empty_scene_has_the_defaults_that_the_page_says():
    scene = scene_of({})
    assert (scene.camera.fov, scene.camera.samples, scene.camera.position) == (45.0, 1, None)
    assert (scene.shade.model, scene.shade.colour) == ("lambert", (0.8, 0.8, 0.8))
    assert (scene.light, scene.dynamic.stencil) == ((), ())
    assert scene.dynamic.matrix == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    assert (scene.budget.pool_bytes, scene.budget.refine) == (1 << 28, "closed")


def test_ambient_light_is_all_there_is_only_where_no_light_is_written():
    assert scene_of({}).ambient == 1.0
    assert scene_of({"light": [{**SUN, "intensity": 0}]}).ambient == 0.2
    assert scene_of({"light": [SUN], "shade": {"ambient": 0}}).ambient == 0.0


def test_a_light_has_what_its_kind_has():
    sun, lamp = scene_of({"light": [SUN, {"kind": "point", "position": [1, 2, 3]}]}).light
    assert (sun.direction, sun.colour, sun.intensity) == ((-1.0, 0.0, -1.0), (1.0, 1.0, 1.0), 1.0)
    assert (lamp.position, lamp.radius, lamp.direction) == ((1.0, 2.0, 3.0), 0.0, (0.0, 0.0, 0.0))


def test_an_error_is_one_line_of_file_key_fault_and_remedy(tmp_path: Path):
    path = tmp_path / "s.toml"
    path.write_text('"a\\nb" = 1\n')
    with pytest.raises(SceneError, match=r"^\S+s\.toml: 'a\\nb': is no such key; it may be sou.*$"):
        read_scene(path)
    path.write_text("[camera]\nfov = 171\n")
    said = f"{path}: camera.fov: 171 is above 170; give another number"
    with pytest.raises(SceneError, match=f"^{re.escape(said)}$"):
        read_scene(path)


@pytest.mark.parametrize(
    "text", [b"\xff", b"a = ", b"a = 1\na = 2\n", b"a = " + b"[" * 5000, b"a = " + b"9" * 5000]
)
def test_what_is_no_toml_is_said_to_be_none(text, tmp_path):
    path = tmp_path / "s.toml"
    path.write_bytes(text)
    with pytest.raises(SceneError) as error:
        read_scene(path)
    assert error.value.key == "no TOML"
    assert "\n" not in str(error.value)


def test_a_missing_column_is_refused_with_its_name_and_the_command_that_would_store_it():
    scene = scene_of({"light": [SUN]}, "sun.toml")
    with pytest.raises(RefusedSceneError) as error:
        resolve(scene, Facts(frozenset({"occupancy", "mask"})))
    assert (error.value.key, error.value.column) == ("lit", "normal")
    assert "gstream build INPUT -o FILE --scene sun.toml" in str(error.value)


def test_a_refusal_names_what_would_show_it():
    with pytest.raises(RefusedSceneError, match=r"ambient-occlusion: .*ray-casting viewer"):
        resolve(scene_of({"shade": {"ao": 36}}), FACTS)


def test_an_explanation_has_a_line_for_each_effect_with_its_reason_and_its_cost():
    resolution = resolve(scene_of({"light": [{**SUN, "shadows": True}]}), FACTS)
    lines = explain(resolution).splitlines()
    assert [line.split()[0] for line in lines[1 : 1 + len(resolution.effects)]] == [
        *resolution.effects
    ]
    (shadow,) = [line for line in lines if line.startswith("shadow ")]
    assert "lights.shadows > 0" in shadow
    assert "drawn once more for each light" in shadow
