"""Scene files: what they say, as records. Source: spec/scene.md; scene-keys.toml has the rules.

What a scene calls for is in gstream_tools.scene.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

RULES: Final = files("gstream_spec").joinpath("scene-keys.toml").read_text("utf-8")
KEYS: Final = tomllib.loads(RULES)
BARE: Final = re.compile(r"[A-Za-z0-9_-]+")

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
ZERO: Final = (0.0, 0.0, 0.0)


class SceneError(Exception):
    """A scene file that breaks a rule: file, key, what is wrong, what to do; one line."""

    def __init__(self, path: str, key: str, said: str, remedy: str) -> None:
        super().__init__(path, key, said, remedy)
        self.path, self.key, self.said, self.remedy = path, key, said, remedy

    def __str__(self) -> str:
        return f"{self.path}: {self.key}: {self.said}; {self.remedy}"


@dataclass(frozen=True, slots=True)
class Source:
    file: str
    kind: str
    colours: str


@dataclass(frozen=True, slots=True)
class Light:
    """What its kind does not have is 0."""

    kind: str
    colour: Vector
    intensity: float
    shadows: bool
    direction: Vector = ZERO
    angle: float = 0.0  # degrees
    position: Vector = ZERO
    radius: float = 0.0


@dataclass(frozen=True, slots=True)
class Camera:
    azimuth: float  # degrees
    elevation: float  # degrees
    projection: str
    fov: float  # degrees
    samples: int
    sraa: bool
    aperture: float
    shutter: float
    position: Vector | None = None  # None: fitted to the box
    target: Vector | None = None  # None: the middle of the box
    up: Vector | None = None  # None: the file's up axis, else z
    height: float | None = None  # None: fitted to the box
    focus: float | None = None


@dataclass(frozen=True, slots=True)
class Shade:
    model: str
    colour: Vector
    specular: float
    shininess: float
    background: Vector
    ao: int
    reflection: float
    refraction: float
    glossy: float
    scattering: float
    paths: int
    ambient: float | None = None  # see Scene.ambient


@dataclass(frozen=True, slots=True)
class Lod:
    pixel_error: float


@dataclass(frozen=True, slots=True)
class Stencil:
    """What its kind does not have is 0."""

    kind: str
    inside: str
    centre: Vector = ZERO
    radius: float = 0.0
    low: Vector = ZERO
    size: Vector = ZERO


@dataclass(frozen=True, slots=True)
class Dynamic:
    stencil: tuple[Stencil, ...]
    deform: str
    matrix: Matrix
    axis: str
    along: str
    amplitude: float
    wavelength: float
    phase: float  # degrees


@dataclass(frozen=True, slots=True)
class Hybrid:
    enabled: bool


@dataclass(frozen=True, slots=True)
class Budget:
    pool_bytes: int
    upload_per_frame: int
    io: str
    refine: str
    occlusion: bool
    streaming: str


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene file; field for field what spec/scene.md says, lengths in world units."""

    source: Source
    light: tuple[Light, ...]
    camera: Camera
    shade: Shade
    lod: Lod
    dynamic: Dynamic
    hybrid: Hybrid
    budget: Budget
    path: str = ""

    @property
    def lights(self) -> tuple[Light, ...]:
        """Those that are not black."""
        return tuple(light for light in self.light if light.intensity > 0 and max(light.colour) > 0)

    @property
    def ambient(self) -> float:
        """Of a scene that does not say: all light where there are no light tables, else a fifth."""
        if self.shade.ambient is not None:
            return self.shade.ambient
        return 0.2 if self.light else 1.0


CLASSES: Final[Mapping[str, Any]] = {
    "scene": Scene,
    "source": Source,
    "light": Light,
    "camera": Camera,
    "shade": Shade,
    "lod": Lod,
    "dynamic": Dynamic,
    "stencil": Stencil,
    "hybrid": Hybrid,
    "budget": Budget,
}


def read_scene(path: str | Path) -> Scene:
    """errors : SceneError; OSError for a file that cannot be read"""
    try:
        given = tomllib.loads(Path(path).read_bytes().decode())
    except (ValueError, RecursionError) as error:
        raise SceneError(str(path), "no TOML", str(error), "mend the file") from None
    return scene_of(given, str(path))


def scene_of(given: Mapping[str, Any], path: str = "") -> Scene:
    """The scene of a file's tables.

    errors : SceneError
    """
    kept = {key: value for key, value in given.items() if not key.startswith("x-")}
    scene: Scene = _Reader(path).table("scene", kept, "", path=path)
    return scene


@dataclass(frozen=True, slots=True)
class _Reader:
    path: str

    def table(self, name: str, given: Any, at: str, **more: str) -> Any:
        if not isinstance(given, dict):
            raise self.error(at, "is no table", f"write [{at}]")
        rules = KEYS[name]
        for key in given:
            if key not in rules:
                raise self.error(_under(at, key), "is no such key", f"it may be {_list(rules)}")
        kind = given.get("kind", rules.get("kind", {}).get("default"))
        values = {}
        for key, rule in rules.items():
            there, fits = _under(at, key), rule.get("for", kind) == kind
            if key in given and not fits:
                raise self.error(there, f"a {kind} {name} has none", "leave it out")
            if key in given:
                values[key] = self.value(key, rule, given[key], there)
            elif fits and rule.get("required"):
                raise self.error(there, f"a {kind} {name} must have it", "give it")
            elif fits and ("default" in rule or rule["type"].startswith("table")):
                default = rule.get("default", {} if rule["type"] == "table" else [])
                values[key] = self.value(key, rule, default, there)
        return CLASSES[name](**values, **more)

    def value(self, key: str, rule: Mapping[str, Any], given: Any, at: str) -> Any:
        """A value of the rule's type, within its limits; arrays as tuples."""
        value: Any = given
        match rule["type"]:
            case "table":
                return self.table(key, given, at)
            case "tables":
                if not isinstance(given, list):
                    raise self.error(at, "is no array of tables", f"write [[{at}]]")
                self.limits({"most": rule["most"]}, [len(given)], at)
                return tuple(self.table(key, row, f"{at}[{i}]") for i, row in enumerate(given))
            case "boolean" | "string" as kind:
                if not isinstance(given, bool if kind == "boolean" else str):
                    raise self.error(at, f"{given!r} is no {kind}", f"give a {kind}")
            case "integer":
                if not isinstance(given, int) or isinstance(given, bool):
                    raise self.error(at, f"{given!r} is no integer", "give an integer")
                self.limits(rule, [given], at)
            case "number":
                (value,) = self.numbers([given], 1, rule, at)
            case "matrix":
                rows = given if isinstance(given, list) and len(given) == 3 else [None]
                value = tuple(self.numbers(row, 3, rule, at) for row in rows)
                if _determinant(*value) <= 0:
                    raise self.error(at, "turns space inside out, or flat", "give another matrix")
            case kind:
                limits = {"least": 0, "most": 1} if kind == "colour" else rule
                value = self.numbers(given, 3, limits, at)
                if rule.get("nonzero") and not any(value):
                    raise self.error(at, "has no direction", "give a number that is not 0")
        if value not in rule.get("one_of", [value]):
            raise self.error(at, f"{value!r} is unknown", f"give {_list(rule['one_of'])}")
        return value

    def numbers(
        self, given: Any, count: int, rule: Mapping[str, Any], at: str
    ) -> tuple[float, ...]:
        said = "a number" if count == 1 else "3 numbers"
        row = given if isinstance(given, list) else []
        real = [n for n in row if isinstance(n, int | float) and not isinstance(n, bool)]
        if len(real) != count or len(row) != count:
            raise self.error(at, f"is not {said}", f"give {said}")
        if not all(abs(number) <= 1e15 for number in real):
            raise self.error(at, "is not finite or above 1e15", "give a smaller number")
        self.limits(rule, real, at)
        return tuple(map(float, real))

    def limits(self, rule: Mapping[str, Any], numbers: Iterable[float], at: str) -> None:
        for number in numbers:
            for limit, out, word in (
                ("least", number < rule.get("least", number), "below"),
                ("most", number > rule.get("most", number), "above"),
                ("above", number <= rule.get("above", number - 1), "not above"),
            ):
                if out:
                    raise self.error(at, f"{number} is {word} {rule[limit]}", "give another number")

    def error(self, key: str, said: str, remedy: str) -> SceneError:
        return SceneError(self.path, key, said, remedy)


def _under(at: str, key: str) -> str:
    name = key if BARE.fullmatch(key) else repr(key)
    return f"{at}.{name}" if at else name


def _list(words: Iterable[object]) -> str:
    return ", ".join(map(str, words))


def _determinant(a: Vector, b: Vector, c: Vector) -> float:
    x, y = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2]
    return a[0] * x + a[1] * y + a[2] * (b[0] * c[1] - b[1] * c[0])
