"""The frozen scenes of spec/vectors/scenes: each with facts, and what must come of it."""

import json
from pathlib import Path
from typing import Any

SCENES = Path(__file__).parents[2] / "spec" / "vectors" / "scenes"
NAMES = sorted(path.stem for path in SCENES.glob("*.toml"))


def expected(name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The facts, and the answer."""
    answer = json.loads((SCENES / f"{name}.json").read_text())
    return answer.pop("facts"), answer
