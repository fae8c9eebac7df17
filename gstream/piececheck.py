"""Checking the source triangles of a block; the rules' sentences are in gstream/check.py."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.blockview import BlockView
from gstream.formats.findings import ERROR, Finding
from gstream.formats.pieces import Pieces


def piece_findings(view: BlockView, pieces: Pieces) -> Iterator[Finding]:
    """What is wrong with the decoded pieces of a block: the first that is found."""
    vertices, triangles = pieces
    said = ""
    if view.level and (len(vertices) or len(triangles)):
        said = "has triangles above level 0"
    elif vertices.max(initial=0) > view.file.block_edge << view.file.header.snap_bits:
        said = "has a vertex outside"
    elif _repeats(vertices):
        said = "has a vertex twice"
    elif len(np.unique(triangles)) != len(vertices):
        said = "has a vertex of no triangle"
    elif (triangles == np.roll(triangles, 1, axis=1)).any():
        said = "has a triangle with two corners at one vertex"
    if said:
        yield Finding("GSB-0414", ERROR, f"level {view.level}, block {view.key}", f"it {said}")


def _repeats(rows: NDArray[Any]) -> bool:
    ordered = rows[np.lexsort(rows.T)]
    return bool((ordered[1:] == ordered[:-1]).all(axis=1).any())
