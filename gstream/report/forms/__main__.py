"""Forms on one scene: the request as JSON in the first argument, the results on stdout."""

import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from gstream.report.forms import accumulator, attributes, classification, levels
from gstream.report.forms.stand import Result, Stand
from gstream.report.truth.mesh import scene_of_stream
from gstream.report.truth.scenes import SCENES

FORMS: dict[str, Callable[[Stand], list[Result]]] = {
    "classification": classification.measure,
    "sums": accumulator.measure,
    "colour-bits": attributes.colour_bits,
    "face-threshold": attributes.faces,
    "lod-weight": levels.lod_weight,
    "lod-codes": levels.lod_codes,
}


def measure(
    forms: list[str],
    scene: str,
    fineness: int,
    stream: str,
    resolution: int,
    matrix: list[list[float]],
) -> dict[str, list[Result]]:
    """All values of each form named; none where a scene has nothing to measure it on.

    scene, fineness, stream : a built-in scene and how fine it is, or a name and its stream
    resolution, matrix : of the default's grid, at most 256; (3, 4) voxel index -> world
    """
    made = SCENES[scene](fineness) if scene in SCENES else scene_of_stream(scene, stream)
    placed = np.array(matrix)
    stand = Stand(made, resolution, float(placed[0, 0]), placed[:, 3])
    return {form: FORMS[form](stand) for form in forms}


if __name__ == "__main__":
    request: dict[str, Any] = json.loads(sys.argv[1])
    found = measure(**request)
    print(json.dumps({form: [asdict(one) for one in results] for form, results in found.items()}))
