"""Scenes of all kinds for hypothesis, as the tables that a TOML file would have."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

SPEC = Path(__file__).parents[2] / "spec"
KEYS = tomllib.loads((SPEC / "scene-keys.toml").read_text())
REFUSED = {  # keys that call for what is refused, where they are not 0
    "source": {"kind"},
    "light": {"angle", "radius"},
    "camera": {"aperture", "shutter"},
    "shade": {"ao", "reflection", "refraction", "glossy", "scattering", "paths"},
}
JUNK = st.sampled_from(
    [True, 0, -1, 7, 0.5, 1e300, float("nan"), "", "x", [], [1], [0, 0, 0], [1, 2, True], {}, [{}]]
)
UNKNOWN = ["wrong", "_", "-0", "", "a b", "a.b", "ä", "\n"]
FACTS = st.fixed_dictionaries(
    {
        "columns": st.sets(st.sampled_from(["normal", "colour", "geometry"])).map(
            lambda some: ["occupancy", "mask", *sorted(some)]
        ),
        "levels": st.integers(1, 17),
        "blocks": st.integers(1, 500),
        "voxels": st.integers(0, 1 << 28),
        "constant_colour": st.booleans(),
        "geometry_bytes": st.integers(0, 1 << 30),
    }
)


def numbers(rule: Mapping[str, Any]) -> st.SearchStrategy[float]:
    """Lawful ones, the limits among them."""
    least, most = rule.get("least", rule.get("above", -1e15)), rule.get("most", 1e15)
    found = st.floats(least, most, exclude_min="above" in rule) | st.just(rule.get("default", most))
    return found | st.just(most) | (st.just(least) if "above" not in rule else st.nothing())


def lawful(key: str, rule: Mapping[str, Any], shown: bool) -> st.SearchStrategy[Any]:
    """Values of a key that are no error; shown : nor refused."""
    if "one_of" in rule:
        return st.sampled_from(rule["one_of"])
    triple = {"vector": numbers(rule), "colour": st.floats(0, 1)}
    match rule["type"]:
        case "boolean":
            return st.booleans()
        case "string":
            return st.text(max_size=3)
        case "integer":
            return st.integers(rule["least"], rule["most"])
        case "number":
            return numbers(rule)
        case "vector" | "colour" as kind:
            rows = st.lists(triple[kind], min_size=3, max_size=3)
            return rows.filter(any) if rule.get("nonzero") else rows
        case "matrix":
            identity = [[1, 0, 0], [0, 1.0, 0], [0, 0, 1]]
            return st.sampled_from([identity, [[2, 0.5, 0], [0, 1, 0], [0, 0, 1]]])
        case "tables":
            return st.lists(table(key, shown), max_size=3)
        case _:
            return table(key, shown)


@st.composite
def table(draw: st.DrawFn, name: str, shown: bool) -> dict[str, Any]:
    """A lawful table: some of its keys, all that it must have."""
    rules, given = KEYS[name], {}
    for key, rule in rules.items():
        kind = given.get("kind", rules.get("kind", {}).get("default"))
        fits = rule.get("for", kind) == kind and not (shown and key in REFUSED.get(name, ()))
        if fits and (rule.get("required") or draw(st.booleans())):
            given[key] = draw(lawful(key, rule, shown))
    return given


@st.composite
def damaged(draw: st.DrawFn) -> dict[str, Any]:
    """A scene one value of which is anything."""
    scene = draw(table("scene", shown=False))
    name = draw(st.sampled_from(sorted(KEYS["scene"])))
    held = scene.setdefault(name, {})
    row = held[0] if isinstance(held, list) and held else held
    if isinstance(row, dict):
        row[draw(st.sampled_from([*KEYS[name], *UNKNOWN]))] = draw(JUNK)
    else:
        scene[name] = draw(JUNK)
    return scene
