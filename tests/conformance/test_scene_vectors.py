"""The frozen scenes, asked of the viewers' resolver."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from conformance.scene_vectors import NAMES, SCENES, expected

from gstream_tools.scene import Facts, RefusedSceneError, SceneError, read_scene, resolve


def viewer(path: Path, facts: Mapping[str, Any]) -> dict[str, Any]:
    """What gstream_tools.scene makes of a scene."""
    try:
        found = resolve(
            read_scene(path), Facts(**{**facts, "columns": frozenset(facts["columns"])})
        )
    except RefusedSceneError as error:
        return {"refused": error.key} | ({"column": error.column} if error.column else {})
    except SceneError as error:
        return {"error": error.key}
    products = ("effects", "columns", "steps", "passes")
    return {name: list(getattr(found, name)) for name in products} | {"defines": found.defines}


@pytest.mark.parametrize("name", NAMES)
def test_the_viewers_resolver_answers_as_the_vector_says(name):
    facts, answer = expected(name)
    assert viewer(SCENES / f"{name}.toml", facts) == answer
