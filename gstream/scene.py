"""Scene files, as a writer of block files reads them: what is to be stored, and what is not.

Source: spec/scene.md, with its tables scene-keys.toml and effects.toml, which decide. What a job
makes of it is in run/wanted.py; what a picture makes of it is a viewer's business.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import Any, Final

from gstream.errors import InputError, UnsupportedError, UsageError

MOST: Final = 1e15  # of a number without limits of its own
UNIT: Final = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
NUMBERS: Final = {"number": (), "vector": (3,), "colour": (3,), "matrix": (3, 3)}  # type -> shape
WORDS: Final = {
    "table": "a table",
    "tables": "an array of tables",
    "boolean": "true or false",
    "string": "a text",
    "integer": "an integer",
    "number": "a number",
    "vector": "3 numbers",
    "colour": "3 numbers",
    "matrix": "3 rows of 3 numbers",
}
PLAIN: Final = {"table": dict, "tables": list, "boolean": bool, "string": str, "integer": int}


def _table(name: str) -> Mapping[str, Any]:
    return tomllib.loads(files("gstream_spec").joinpath(name).read_text("utf-8"))


KEYS: Final = _table("scene-keys.toml")
EFFECTS: Final = _table("effects.toml")


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene whose keys are lawful; `tables` has every default."""

    path: str
    tables: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Facts:
    """What is known of a block file, or of the source of one that is not written yet."""

    columns: frozenset[str]  # "geometry" stands for the source triangles' columns
    levels: int
    blocks: int = 1
    voxels: int = 0  # of all levels
    constant_colour: bool = False
    geometry_bytes: int = 0


@dataclass(frozen=True, slots=True)
class Resolution:
    """What a scene calls for, in the orders of effects.toml."""

    effects: Mapping[str, str]  # name -> the conditions that hold, as a sentence
    columns: tuple[str, ...]
    steps: tuple[str, ...]
    passes: tuple[str, ...]
    defines: Mapping[str, int]


def read_scene(path: str) -> Scene:
    """errors : UsageError for a file that cannot be read; InputError for one that is no scene"""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        said = f"{path}: cannot be read: {error.strerror}"
        raise UsageError(said, "check its name and permissions") from error
    try:
        given = tomllib.loads(data.decode())
    except (ValueError, RecursionError) as error:
        raise InputError(path, "", f"is no TOML: {error}", "mend the file") from None
    return scene_of(given, path)


def scene_of(given: Mapping[str, Any], path: str = "") -> Scene:
    """The scene of a file's tables.

    errors : InputError, its place the path of the key
    """
    own = {key for key in given if key.startswith("x-")}
    kept = {key: value for key, value in given.items() if key not in own}
    return Scene(path, _Check(path).table("scene", kept, ""))


@dataclass(frozen=True, slots=True)
class _Check:
    """The keys of one file, each under its rule."""

    path: str

    def table(self, name: str, given: Mapping[str, Any], at: str) -> dict[str, Any]:
        rules = KEYS[name]
        values: dict[str, Any] = {}
        for key in given:
            if key not in rules:
                self.refuse(_place(at, key), "is no such key", f"known are {', '.join(rules)}")
        for key, rule in rules.items():
            place, owner = _place(at, key), rule.get("for")
            foreign = owner is not None and owner != values["kind"]
            if foreign and key in given:
                self.refuse(place, f"belongs to kind = {owner!r}", "leave it out")
            if key in given:
                values[key] = self.value(key, rule, given[key], place)
            elif rule.get("required") and not foreign:
                self.refuse(place, "is missing", f"give {WORDS[rule['type']]}")
            elif rule["type"] == "table":
                values[key] = self.table(key, {}, place)
            elif rule["type"] == "tables":
                values[key] = []
            elif "default" in rule and not foreign:
                values[key] = rule["default"]
        return values

    def value(self, key: str, rule: Mapping[str, Any], given: Any, at: str) -> Any:
        kind = rule["type"]
        lawful = _has_shape(given, NUMBERS[kind]) if kind in NUMBERS else type(given) is PLAIN[kind]
        if not lawful:
            self.refuse(at, f"is not {WORDS[kind]}", f"give {WORDS[kind]}")
        if "one_of" in rule and given not in rule["one_of"]:
            self.refuse(at, f"{given!r} is unknown", f"give one of {rule['one_of']}")
        if kind == "table":
            return self.table(key, given, at)
        if kind == "tables":
            self.within({"least": 0, **rule}, [len(given)], at)
            rows = [(row, f"{at}[{i}]") for i, row in enumerate(given)]
            return [self.value(key, {"type": "table"}, *row) for row in rows]
        if kind == "integer" or kind in NUMBERS:
            numbers = list(_flat(given))
            self.within({"least": 0, "most": 1} if kind == "colour" else rule, numbers, at)
            if rule.get("nonzero") and not any(numbers):
                self.refuse(at, "is 0, 0, 0", "give a direction")
            if kind == "matrix" and not _keeps_sides(*given):
                self.refuse(at, "has no determinant above 0", "give another matrix")
        return given

    def within(self, rule: Mapping[str, Any], numbers: Iterable[float], at: str) -> None:
        least, most = rule.get("least", -MOST), rule.get("most", MOST)
        for number in numbers:
            if not least <= number <= most or number <= rule.get("above", -2 * MOST):
                low = f"more than {rule['above']}" if "above" in rule else f"{least:.15g} or more"
                self.refuse(at, f"{number} is out of range", f"give {low}, up to {most:.15g}")

    def refuse(self, at: str, said: str, remedy: str) -> None:
        raise InputError(self.path, at, said, remedy)


def _place(at: str, key: str) -> str:
    name = key if re.fullmatch(r"[\w-]+", key, re.ASCII) else repr(key)
    return f"{at}.{name}" if at else name


def _has_shape(given: Any, shape: tuple[int, ...]) -> bool:
    if not shape:
        return type(given) in (int, float)
    rows = type(given) is list and len(given) == shape[0]
    return rows and all(_has_shape(part, shape[1:]) for part in given)


def _flat(given: Any) -> Iterator[float]:
    return chain.from_iterable(map(_flat, given)) if isinstance(given, list) else iter([given])


def _keeps_sides(*rows: list[float]) -> bool:
    (a, b, c), (d, e, f), (g, h, i) = (map(float, row) for row in rows)
    return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) > 0


def resolve(scene: Scene, facts: Facts) -> Resolution:
    """The effects that the scene calls for, of those that the columns of `facts` allow.

    errors : UnsupportedError for one that no viewer of surfaces can show, or whose column the
        source does not have
    """
    known = _known(scene, facts)
    for refusal in EFFECTS["refusal"]:
        if _reason(refusal["when"], known):
            said = f"{refusal['name']}: {refusal['said']}"
            raise UnsupportedError(scene.path, said, refusal["hint"])
    found: dict[str, str] = {}
    rows = []
    for effect in EFFECTS["effect"]:
        name, reason = effect["name"], _reason(effect["when"], known)
        known[name] = bool(reason)
        if not reason:
            continue
        for column in effect.get("columns", ()):
            if column not in facts.columns:
                said = f"{name}: the source has no {column}"
                raise UnsupportedError(scene.path, said, "change the scene, or take another source")
        known["voxel_bytes"] += facts.voxels * effect.get("voxel_bytes", 0)
        found[name] = reason
        rows.append(effect)
    values = chain.from_iterable(effect.get("defines", {}).items() for effect in rows)

    def named(what: str) -> tuple[str, ...]:
        return tuple(n for n in EFFECTS[what] if any(n in row.get(what, ()) for row in rows))

    return Resolution(
        effects=found,
        columns=named("columns"),
        steps=named("steps"),
        passes=named("passes"),
        defines={name: int(known.get(value, value)) for name, value in values},
    )


def _known(scene: Scene, facts: Facts) -> dict[str, Any]:
    """The value of each term that a condition may name."""
    tables = scene.tables
    lights = [row for row in tables["light"] if row["intensity"] > 0 and any(row["colour"])]
    blocked = [row for row in lights if row["shadows"]]
    dynamic = tables["dynamic"]
    moves = {"shear": dynamic["matrix"] != UNIT, "wave": 2 * (dynamic["amplitude"] > 0)}
    single = (name for name, rule in KEYS["scene"].items() if rule["type"] == "table")
    keys = {f"{name}.{key}": value for name in single for key, value in tables[name].items()}
    return keys | {
        "lights": len(lights),
        "lights.shadows": len(blocked),
        "lights.soft": sum(row.get("angle", 0) > 0 or row.get("radius", 0) > 0 for row in blocked),
        "stencils": len(dynamic["stencil"]),
        "deform": int(moves.get(dynamic["deform"], 0)),
        "file.colour": "colour" in facts.columns,
        "file.constant_colour": facts.constant_colour,
        "file.levels": facts.levels,
        "file.blocks": facts.blocks,
        "file.geometry_bytes": facts.geometry_bytes,
        "voxel_bytes": 0,
    }


def _reason(when: Iterable[Iterable[str]], known: Mapping[str, Any]) -> str:
    """The first row of conditions that all hold, as words; empty if there is none."""
    for row in when:
        if all(_holds(condition, known) for condition in row):
            return " and ".join(row) or "always"
    return ""


def _holds(condition: str, known: Mapping[str, Any]) -> bool:
    term, relation, value = condition.split()
    if relation == ">":
        return float(known[term]) > float(known[value] if "." in value else value)
    wanted = {"true": True, "false": False}.get(value, value)
    return bool((known[term] == wanted) == (relation == "="))


def explain(resolution: Resolution) -> Iterator[str]:
    """Lines for people: each effect, what in the scene calls for it, what is stored for it."""
    rows = [("effect", "called for by", "stored")]
    for effect in EFFECTS["effect"]:
        if effect["name"] in resolution.effects:
            levels = ["levels of detail"] * (effect["name"] == "lod")
            stored = ", ".join([*effect.get("columns", ()), *levels]) or "nothing"
            rows.append((effect["name"], resolution.effects[effect["name"]], stored))
    first, second = (max(len(row[i]) for row in rows) for i in range(2))
    for name, reason, stored in rows:
        yield f"{name:{first}}  {reason:{second}}  {stored}"
    yield f"columns  {' '.join(resolution.columns)}"
    yield f"steps    {' '.join(resolution.steps)}"
