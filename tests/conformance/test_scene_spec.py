"""spec/scene.md, scene-keys.toml and effects.toml: that page and tables say the same."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from conformance.scene_answers import NAMES, expected

SPEC = Path(__file__).parents[2] / "spec"
PAGE = (SPEC / "scene.md").read_text()
KEYS = tomllib.loads((SPEC / "scene-keys.toml").read_text())
TABLE = tomllib.loads((SPEC / "effects.toml").read_text())
HEADS = {name: f"`[{name}]`" for name in KEYS} | {
    "light": "`[[light]]`",
    "stencil": "`[[dynamic.stencil]]`",
}


def rows(table: str) -> dict[str, str]:
    """Key to default, as the page's table of this name has them."""
    text = PAGE[PAGE.index(HEADS[table]) :]
    lines = text[text.index("|---|---|---|\n") :].splitlines()[1:]
    found = {}
    for line in lines:
        if not line.startswith("|"):
            return found
        names, default, _ = (cell.strip() for cell in line.strip("|").split("|", 2))
        found |= dict.fromkeys(names.split(", "), default)
    return found


@pytest.mark.parametrize("table", [name for name in KEYS if name != "scene"])
def test_the_page_has_every_key_and_no_other(table):
    assert rows(table).keys() == KEYS[table].keys()


@pytest.mark.parametrize("table", [name for name in KEYS if name != "scene"])
def test_the_page_has_the_defaults_of_the_keys(table):
    for key, default in rows(table).items():
        rule = KEYS[table][key]
        if default.startswith("`"):
            assert tomllib.loads(f"stated = {default.strip('`')}")["stated"] == rule["default"], key
        else:
            assert "default" not in rule, key
            assert rule.get("required", False) == (default == "required"), key


def test_every_table_is_one_of_the_scene_or_of_an_array_in_it():
    arrays = {
        key for table in KEYS.values() for key, rule in table.items() if "table" in rule["type"]
    }
    assert arrays == KEYS.keys() - {"scene"}


def test_conditions_name_terms_of_the_page_keys_or_effects_above_them():
    terms = set(re.findall(r"^\| ([a-z_., ]+) \|", PAGE[PAGE.index("## 3.") :], re.MULTILINE))
    known = {term for cell in terms for term in cell.split(", ")}
    known |= {f"{table}.{key}" for table, rules in KEYS.items() for key in rules}
    for row in (*TABLE["refusal"], *TABLE["effect"]):
        for condition in (c for clause in row["when"] for c in clause):
            left, relation, right = condition.split()
            assert left in known
            assert relation in ("=", "!=", ">")
            assert "." not in right or right in known
        if row in TABLE["effect"]:
            known.add(row["name"])
            assert {text for text in row.get("defines", {}).values()} <= known | {"1"}


def test_what_effects_name_stands_in_the_orders():
    for product in ("columns", "steps", "passes"):
        named = {name for row in TABLE["effect"] for name in row.get(product, ())}
        assert named == set(TABLE[product])


def test_every_effect_refusal_and_column_has_a_vector():
    answers = [expected(name)[1] for name in NAMES]
    shown = {effect for answer in answers for effect in answer.get("effects", ())}
    assert shown == {row["name"] for row in TABLE["effect"]}
    refused = {answer["refused"] for answer in answers if answer.keys() == {"refused"}}
    assert refused == {row["name"] for row in TABLE["refusal"]}
    missing = {answer["column"] for answer in answers if "column" in answer}
    assert missing == set(TABLE["columns"]) - {"occupancy", "mask"}


def test_every_effect_is_absent_from_a_vector():
    shown = [set(answer["effects"]) for _, answer in map(expected, NAMES) if "effects" in answer]
    assert set.intersection(*shown) == {"visibility"}


def test_a_vector_is_a_scene_and_its_answer():
    folder = SPEC / "vectors" / "scenes"
    assert sorted(path.stem for path in folder.glob("*.json")) == NAMES
    for name in NAMES:
        assert json.loads((folder / f"{name}.json").read_text()).keys() >= {"facts"}
