"""A mesh as its own true surface: exact distances, what is inside, and whether it is closed.

Inside is where a ray towards -z crosses the surface an odd number of times.
"""

from collections.abc import Iterator
from math import ceil, sqrt
from pathlib import Path

import numpy as np

from gstream.errors import UsageError
from gstream.formats.stream import StreamReader, corners
from gstream.report.truth.scene import SAMPLES, Bools, Floats, Ints, Scene, spread_on
from gstream.report.truth.tree import Tree

MAX_TRIANGLES = 1 << 22
PAIRS = 1 << 18  # of triangle and column tested at once


def scene_of_stream(name: str, path: str | Path) -> Scene:
    """The triangles of a geometry stream as a scene: positions as stored, without colours.

    errors : UsageError for more than 2^22 triangles, or none with an area; CorruptFileError
    """
    reader = StreamReader(path)
    count = int(reader.chunks["triangles"].sum())
    if count > MAX_TRIANGLES:
        said = f"{path}: {count} triangles, and the report judges at most {MAX_TRIANGLES}"
        raise UsageError(said, "give a part of the mesh, or a simplified one")
    parts = [corners(reader.chunk(i, ()))[0] for i in range(len(reader.chunks))]
    held = np.concatenate([np.empty((0, 3, 3)), *parts])
    return scene_of_mesh(name, held.reshape(-1, 3), np.arange(len(held) * 3).reshape(-1, 3))


def scene_of_mesh(name: str, points: Floats, triangles: Ints) -> Scene:
    """A mesh that is the surface itself; vertices at one position count as one.

    points : (n, 3) float64, finite; triangles : (m, 3), anticlockwise from outside
    returns : a scene whose `inside` is None where the mesh is not closed
    errors : UsageError where no triangle has an area
    """
    points, number = _welded(points)
    triangles = number[triangles]
    held = points[triangles]
    area = np.linalg.norm(_doubled(held), axis=1) / 2
    if not area.any():
        raise UsageError(f"{name}: no triangle has an area", "give a mesh with a surface")
    tree = Tree(held[area > 0])
    closed = _is_closed(triangles)
    return Scene(
        name,
        points,
        triangles,
        tree.nearest,
        samples=spread_on(held, SAMPLES),
        area=float(area.sum()),
        closed=closed,
        inside=(lambda at: _inside(points, triangles, at)) if closed else None,
        flat=True,
    )


def _welded(points: Floats) -> tuple[Floats, Ints]:
    """Each position once, and the number that each of (n, 3) points then has."""
    order = np.lexsort(points.T)
    ordered = points[order]
    new = _unlike_before(ordered)
    number = np.empty(len(points), np.int64)
    number[order] = np.cumsum(new) - 1
    return ordered[new], number


def _unlike_before(rows: Floats) -> Bools:
    """(n,) whether each row is another than the one before."""
    new = np.ones(len(rows), np.bool_)
    new[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    return new


def _is_closed(triangles: Ints) -> bool:
    """Whether each edge is there as often in one direction as in the other."""
    begin, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    count = triangles.max() + 1
    return np.array_equal(np.sort(begin * count + end), np.sort(end * count + begin))


def _doubled(held: Floats) -> Floats:
    """(m, 3) normals of (m, 3, 3) triangles, twice their area long."""
    a, b, c = held.transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def _inside(points: Floats, triangles: Ints, at: Floats) -> Bools:
    """(k,) whether (k, 3) points are inside a closed mesh moved by (e1 >> e2 >> e3 > 0).

    As good as float64 on a tie: exact where all differences and products are, as on a lattice.
    """
    if not len(at):
        return np.zeros(0, np.bool_)
    order = np.lexsort(at.T[::-1])  # by x, then y: one column after another, upwards
    ordered = at[order]
    new = _unlike_before(ordered[:, :2])
    column = np.cumsum(new) - 1
    found = [
        _crossings(points, triangles[owner], ordered[new, :2], which)
        for owner, which in _pairs(points[triangles][..., :2], ordered[new, :2])
    ]
    where, height, above = (np.concatenate(part) for part in zip(*found, strict=True))
    # each point among the crossings of its column; one that is moved down past it comes before
    kind = np.concatenate([np.zeros(len(at), np.int64), np.where(above, 1, -1)])
    heights = np.concatenate([ordered[:, 2], height])
    merged = np.lexsort((kind, heights, np.concatenate([column, where])))
    seen = np.empty(len(merged), np.int64)
    seen[merged] = np.cumsum(kind[merged] != 0)
    before = np.cumsum(np.bincount(where + 1, minlength=column[-1] + 2))
    inside = np.empty(len(at), np.bool_)
    inside[order] = (seen[: len(at)] - before[column]) % 2 == 1
    return inside


def _pairs(held: Floats, columns: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Triangles and columns whose bounding boxes meet in x and y, in parts of bounded size.

    held : (m, 3, 2) corners; columns : (c, 2)
    """
    side = ceil(sqrt(len(columns)))  # a lattice of side^2 cells: one column in each, or so
    low, high = columns.min(axis=0), columns.max(axis=0)
    steps = side / np.where(high > low, high - low, 1)

    def cell(at: Floats) -> Ints:
        cells: Ints = np.clip(np.floor((at - low) * steps), 0, side - 1).astype(np.int64)
        return cells

    x, y = cell(columns).T
    ordered = np.argsort(x * side + y, kind="stable")
    starts = np.searchsorted((x * side + y)[ordered], np.arange(side * side + 1))
    least, most = held.min(axis=1), held.max(axis=1)
    near = np.flatnonzero(((most >= low) & (least <= high)).all(axis=1))
    first, last = cell(least[near]), cell(most[near])
    rows = last[:, 0] - first[:, 0] + 1
    owner = np.repeat(np.arange(len(near)), rows)
    row = (first[owner, 0] + _counted(rows)) * side
    begin, end = starts[row + first[owner, 1]], starts[row + last[owner, 1] + 1]
    until = np.cumsum(end - begin)
    for part in np.split(np.arange(len(owner)), np.flatnonzero(np.diff(until // PAIRS)) + 1):
        counts = (end - begin)[part]
        which = ordered[np.repeat(begin[part], counts) + _counted(counts)]
        yield near[np.repeat(owner[part], counts)], which


def _counted(counts: Ints) -> Ints:
    """0, 1, ... anew for each of the counts."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def _crossings(
    points: Floats, triangles: Ints, columns: Floats, which: Ints
) -> tuple[Ints, Floats, Bools]:
    """Where columns cross triangles, one pair each.

    returns : (c,) the column, its height there, and whether the infinitesimal moves that upwards
    """
    at = columns[which]
    sides = [_left_of(points, triangles[:, i], triangles[:, (i + 1) % 3], at) for i in range(3)]
    hit = (sides[0] == sides[1]) & (sides[1] == sides[2])
    held, at = points[triangles[hit]], at[hit]
    normal = _doubled(held)
    up = normal[:, 2]  # zero only by rounding: no column is left of all edges of one on edge
    first = np.where(normal[:, 0] != 0, normal[:, 0], np.where(normal[:, 1] != 0, normal[:, 1], up))
    fall = ((at - held[:, 0, :2]) * normal[:, :2]).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = held[:, 0, 2] - fall / up
    height = np.clip(height, held[:, :, 2].min(axis=1), held[:, :, 2].max(axis=1))
    return which[hit], height, first * up > 0


def _left_of(points: Floats, begin: Ints, end: Ints, at: Floats) -> Bools:
    """(n,) whether places are left of edges in x and y; an edge's two directions never agree."""
    p, q = points[np.minimum(begin, end)], points[np.maximum(begin, end)]
    x, y = (q - p)[:, :2].T
    turn = x * (at[:, 1] - p[:, 1]) - y * (at[:, 0] - p[:, 0])
    left = (turn > 0) | (turn == 0) & ((y > 0) | (y == 0) & (x < 0))
    turned: Bools = left ^ (begin > end)
    return turned
