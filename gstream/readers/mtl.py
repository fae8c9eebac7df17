"""MTL: the diffuse colour of each material, from files inside the input's own folder only."""

from collections.abc import Iterator
from contextlib import suppress
from os import fsdecode
from pathlib import Path

MAX_LINE = 1024  # bytes; the rest of a longer line is read as another, and means nothing
MAX_MATERIALS = 1 << 16
Colour = tuple[int, int, int, int]


def inside(folder: Path, library: bytes) -> Path | None:
    """The path of a mtllib if it resolves inside `folder`, links followed; None if it does not."""
    label = fsdecode(library).replace("\\", "/")
    if "\0" in label or "://" in label or label.startswith(("/", "file:")) or label[1:2] == ":":
        return None
    try:
        path = (folder / label).resolve()
        return path if path.is_relative_to(folder.resolve()) else None
    except (OSError, RuntimeError, ValueError):  # a loop of links, or a name the system refuses
        return None


def read_colours(path: Path) -> dict[bytes, Colour]:
    """Kd of each material as an sRGB code, the value taken as it is displayed: round(255 * Kd)."""
    colours: dict[bytes, Colour] = {}
    name: bytes | None = None
    for line in _lines(path):
        words = line.split(None, 1)
        if len(words) < 2:
            continue
        if words[0] == b"newmtl":
            name = words[1].strip() if len(colours) < MAX_MATERIALS else None
        elif words[0] == b"Kd" and name is not None:
            with suppress(ValueError):  # "Kd spectral" and "Kd xyz" are no RGB
                given = [float(word) for word in words[1].split()[:3]]
                red, green, blue = given if len(given) == 3 else given[:1] * 3
                colours[name] = (_code(red), _code(green), _code(blue), 255)
    return colours


def _code(value: float) -> int:
    return int(min(max(value, 0.0), 1.0) * 255 + 0.5) if value == value else 0


def _lines(path: Path) -> Iterator[bytes]:
    with open(path, "rb") as file:
        while line := file.readline(MAX_LINE):
            yield line
