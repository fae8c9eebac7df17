"""The effects that a scene calls for, and what they take. Source: spec/scene.md, effects.toml.

Nothing here draws, and nothing reads a block file: what is known of one comes as `Facts`.
"""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from importlib.resources import files
from typing import Any, Final

from .scene_file import Dynamic, Scene, SceneError, read_scene, scene_of

RULES: Final = files("gstream_spec").joinpath("effects.toml").read_text("utf-8")
TABLE: Final = tomllib.loads(RULES)
STORE: Final = "store it: gstream build INPUT -o FILE --scene"

__all__ = [
    "Facts", "RefusedSceneError", "Resolution", "Scene", "SceneError",
    "explain", "read_scene", "resolve", "scene_of",
]  # fmt: skip


class RefusedSceneError(SceneError):
    """A scene that cannot be shown; `key` is the effect's name, `column` one that is missing."""

    def __init__(self, path: str, key: str, said: str, remedy: str, column: str = "") -> None:
        super().__init__(path, key, said, remedy)
        self.column = column


@dataclass(frozen=True, slots=True)
class Facts:
    """What is known of a block file, or before there is one of its source."""

    columns: frozenset[str]  # by name; "geometry" stands for the source triangles' columns
    levels: int = 1
    blocks: int = 1
    voxels: int = 0  # of all levels
    constant_colour: bool = False  # all voxels have one colour
    geometry_bytes: int = 0  # of the source triangles, as they lie in a pool


@dataclass(frozen=True, slots=True)
class Resolution:
    """What a scene calls for, in the orders of effects.toml."""

    effects: tuple[str, ...]
    columns: tuple[str, ...]
    steps: tuple[str, ...]
    passes: tuple[str, ...]
    defines: Mapping[str, int]
    why: Mapping[str, str] = field(compare=False)  # the conditions of each effect that hold


def resolve(scene: Scene, facts: Facts) -> Resolution:
    """The effects that can change a pixel, and all that they take.

    errors : RefusedSceneError for an effect that cannot be shown, or whose column is missing
    """
    terms = _terms(scene, facts)
    for row in TABLE["refusal"]:
        if _holding(row["when"], terms) is not None:
            raise RefusedSceneError(scene.path, row["name"], row["said"], row["hint"])
    called: dict[str, Any] = {}
    why: dict[str, str] = {}
    for row in TABLE["effect"]:
        name = row["name"]
        clause = _holding(row["when"], terms)
        terms[name] = clause is not None
        if clause is None:
            continue
        called[name], why[name] = row, " and ".join(clause) or "always"
        terms["voxel_bytes"] += facts.voxels * row.get("voxel_bytes", 0)
        for column in row.get("columns", ()):
            if column not in facts.columns:
                said, remedy = f"needs the column {column}, which is not there", STORE
                raise RefusedSceneError(scene.path, name, said, f"{remedy} {scene.path}", column)
    defines = [pair for row in called.values() for pair in row.get("defines", {}).items()]
    return Resolution(
        effects=tuple(called),
        columns=_ordered("columns", called),
        steps=_ordered("steps", called),
        passes=_ordered("passes", called),
        defines={key: int(text if text.isdigit() else terms[text]) for key, text in defines},
        why=why,
    )


def _ordered(product: str, called: Mapping[str, Any]) -> tuple[str, ...]:
    named = {name for row in called.values() for name in row.get(product, ())}
    return tuple(name for name in TABLE[product] if name in named)


def _terms(scene: Scene, facts: Facts) -> dict[str, Any]:
    """What conditions may name: keys of tables, and what scene.md derives."""
    tables: tuple[Any, ...] = (
        scene.source,
        scene.camera,
        scene.shade,
        scene.lod,
        scene.hybrid,
        scene.budget,
    )
    terms = {
        f"{type(table).__name__.lower()}.{key.name}": getattr(table, key.name)
        for table in (*tables, scene.hybrid, scene.budget)
        for key in fields(table)
    }
    shadows = [light for light in scene.lights if light.shadows]
    return terms | {
        "lights": len(scene.lights),
        "lights.shadows": len(shadows),
        "lights.soft": sum(light.angle > 0 or light.radius > 0 for light in shadows),
        "stencils": len(scene.dynamic.stencil),
        "deform": _deform(scene.dynamic),
        "file.colour": "colour" in facts.columns,
        "file.constant_colour": facts.constant_colour,
        "file.levels": facts.levels,
        "file.blocks": facts.blocks,
        "file.geometry_bytes": facts.geometry_bytes,
        "voxel_bytes": 0,
    }


def _deform(dynamic: Dynamic) -> int:
    """0 where nothing moves, 1 shear, 2 wave."""
    unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    shear = dynamic.deform == "shear" and dynamic.matrix != unit
    wave = dynamic.deform == "wave" and dynamic.amplitude > 0
    return 1 if shear else 2 if wave else 0


def _holding(when: Iterable[list[str]], terms: Mapping[str, Any]) -> list[str] | None:
    """The first list of conditions that all hold."""
    return next((clause for clause in when if all(_holds(c, terms) for c in clause)), None)


def _holds(condition: str, terms: Mapping[str, Any]) -> bool:
    left, relation, right = condition.split()
    value = terms[left]
    if relation == ">":
        return bool(value > (terms[right] if "." in right else float(right)))
    same = (str(value).lower() if isinstance(value, bool) else value) == right
    return same if relation == "=" else not same


def explain(resolution: Resolution) -> str:
    """A table for people: each effect, why it is called for, what it costs."""
    costs = {row["name"]: row["cost"] for row in TABLE["effect"]}
    rows = [("effect", "called for by", "costs")]
    rows += [(name, resolution.why[name], costs[name]) for name in resolution.effects]
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    defines = [f"{key}={value}" for key, value in resolution.defines.items()]
    products = (
        f"columns  {' '.join(resolution.columns)}",
        f"passes   {' '.join(resolution.passes)}",
        f"defines  {' '.join(defines) or 'none'}",
    )
    lines = [f"{a:{widths[0]}}  {b:{widths[1]}}  {c}" for a, b, c in rows]
    return "\n".join([*lines, "", *products])
