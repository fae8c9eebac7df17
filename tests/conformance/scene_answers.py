"""The frozen scenes of spec/vectors/scenes, and what both resolvers answer of any scene."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gstream import scene as writer
from gstream.errors import InputError, UnsupportedError
from gstream_tools import scene as viewer

SCENES = Path(__file__).parents[2] / "spec" / "vectors" / "scenes"
NAMES = sorted(path.stem for path in SCENES.glob("*.toml"))
PRODUCTS = ("effects", "columns", "steps", "passes")
Answer = dict[str, Any]


def expected(name: str) -> tuple[dict[str, Any], Answer]:
    """The facts of a vector, and the answer."""
    answer = json.loads((SCENES / f"{name}.json").read_text())
    return answer.pop("facts"), answer


def of_viewer(read: Callable[[], viewer.Scene], facts: Mapping[str, Any]) -> Answer:
    """What gstream_tools.scene makes of a scene."""
    known = viewer.Facts(**{**facts, "columns": frozenset(facts["columns"])})
    try:
        found = viewer.resolve(read(), known)
    except viewer.RefusedSceneError as error:
        return {"refused": error.key} | ({"column": error.column} if error.column else {})
    except viewer.SceneError as error:
        return {"error": error.key}
    return {name: list(getattr(found, name)) for name in PRODUCTS} | {"defines": found.defines}


def of_writer(read: Callable[[], writer.Scene], facts: Mapping[str, Any]) -> Answer:
    """What gstream.scene makes of one; refusals are told by the names in their messages."""
    known = writer.Facts(**{**facts, "columns": frozenset(facts["columns"])})
    try:
        found = writer.resolve(read(), known)
    except InputError as error:
        return {"error": error.place}
    except UnsupportedError as error:
        name, said = error.said.split(": ", 1)
        column = said.removeprefix("the source has no ")
        return {"refused": name} | ({"column": column} if column != said else {})
    return {name: list(getattr(found, name)) for name in PRODUCTS} | {"defines": found.defines}
