"""Both resolvers: what the frozen scenes say, and that they agree about any other."""

import copy
from typing import Any

import pytest
from conformance.scene_answers import NAMES, PRODUCTS, SCENES, expected, of_viewer, of_writer
from conformance.scene_strategies import FACTS, damaged, table
from hypothesis import given
from hypothesis import strategies as st

from gstream import scene as writer
from gstream_tools import scene as viewer

ALL = ["occupancy", "mask", "normal", "colour", "geometry"]
SUN = {"direction": [-1, 0, -1], "shadows": True}


def answers(scene: dict[str, Any], facts: dict[str, Any]) -> list[dict[str, Any]]:
    """Of the viewers' resolver and of the writer's."""
    return [
        of_viewer(lambda: viewer.scene_of(scene), facts),
        of_writer(lambda: writer.scene_of(scene), facts),
    ]


@pytest.mark.parametrize("name", NAMES)
def test_the_viewers_resolver_answers_as_the_vector_says(name):
    facts, answer = expected(name)
    assert of_viewer(lambda: viewer.read_scene(SCENES / f"{name}.toml"), facts) == answer


@pytest.mark.parametrize("name", NAMES)
def test_the_writers_resolver_answers_as_the_vector_says(name):
    facts, answer = expected(name)
    assert of_writer(lambda: writer.read_scene(str(SCENES / f"{name}.toml")), facts) == answer


@given(table("scene", shown=False), FACTS)
def test_both_resolvers_answer_alike_of_any_lawful_scene(scene, facts):
    one, other = answers(scene, facts)
    assert one == other
    assert "error" not in one


@given(damaged(), FACTS)
def test_both_resolvers_find_the_same_scenes_wrong(scene, facts):
    one, other = answers(scene, facts)
    assert one == other


def one_more(scene: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """The scene with a key set, or a table added to an array."""
    more = copy.deepcopy(scene)
    *tables, key = path.split(".")
    held = more
    for name in tables:
        held = held.setdefault(name, {})
    held[key] = [*held.get(key, []), value] if isinstance(value, dict) else value
    return more


MORE = {
    "light": SUN,
    "dynamic.stencil": {"centre": [0, 0, 0], "radius": 1},
    "shade.model": "blinn-phong",
    "shade.specular": 1,
    "source.colours": "required",
    "camera.samples": 8,
    "camera.sraa": True,
    "dynamic.deform": "shear",
    "dynamic.amplitude": 1,
    "dynamic.matrix": [[1, 0, 1], [0, 1, 0], [0, 0, 1]],
    "lod.pixel_error": 1,
    "hybrid.enabled": True,
    "budget.occlusion": True,
    "budget.streaming": "always",
}


@given(table("scene", shown=True), FACTS, st.sampled_from(sorted(MORE)))
def test_what_is_added_to_a_scene_takes_nothing_away(scene, facts, added):
    facts = {**facts, "columns": ALL}
    more = one_more(scene, added, MORE[added])
    for before, after in zip(answers(scene, facts), answers(more, facts), strict=True):
        for product in (*PRODUCTS, "defines"):
            assert set(before[product]) <= set(after[product])


@given(table("scene", shown=True), FACTS)
def test_a_larger_file_takes_nothing_away(scene, facts):
    facts = {**facts, "columns": ALL}
    larger = {key: 2 * facts[key] for key in ("levels", "blocks", "voxels", "geometry_bytes")}
    for before, after in zip(answers(scene, facts), answers(scene, facts | larger), strict=True):
        for product in (*PRODUCTS, "defines"):
            assert set(before[product]) <= set(after[product])


REFUSALS = {
    "lens": ("camera.aperture", 0.01),
    "motion-blur": ("camera.shutter", 1),
    "soft-shadow": ("light", {**SUN, "angle": 0.1}),
    "ambient-occlusion": ("shade.ao", 1),
    "reflection": ("shade.reflection", 0.01),
    "refraction": ("shade.refraction", 0.01),
    "glossy": ("shade.glossy", 1),
    "scattering": ("shade.scattering", 0.5),
    "path-tracing": ("shade.paths", 1),
    "volume": ("source.kind", "volume"),
}


@given(table("scene", shown=True), st.sampled_from(sorted(REFUSALS)))
def test_what_cannot_be_shown_is_refused_by_name_whatever_else_the_scene_has(scene, name):
    scene.get("shade", {}).pop("model", None)
    refused = one_more(scene, *REFUSALS[name])
    assert answers(refused, {"columns": ALL, "levels": 3}) == [{"refused": name}] * 2
