"""Dense grids [x, y, z] of set voxels: neighbours, sides of a convex mesh, and flooding."""

from itertools import product

import numpy as np
from exact import oracle
from numpy.typing import NDArray

Grid = NDArray[np.bool_]
Step = tuple[int, int, int]

NEAR6: list[Step] = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
NEAR26: list[Step] = [
    (x, y, z) for x, y, z in product((-1, 0, 1), repeat=3) if (x, y, z) > (0,) * 3
]
PATHS = {"6": NEAR6, "26": NEAR26, "conservative": NEAR26}


def dense(voxels: NDArray[np.int64], edge: int) -> Grid:
    grid = np.zeros((edge,) * 3, bool)
    grid[tuple(voxels.T)] = True
    return grid


def pairs(grid: Grid, step: Step) -> tuple[Grid, Grid]:
    """The grid and the grid moved by step, cut to where both exist."""
    here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, grid.shape, strict=True))
    there = tuple(slice(max(0, s), n + min(0, s)) for s, n in zip(step, grid.shape, strict=True))
    return grid[here], grid[there]


def leaks(surface: Grid, side: Grid, steps: list[Step]) -> int:
    """Pairs of neighbours that are not set and lie on different sides."""
    count = 0
    for step in steps:
        (set_a, set_b), (side_a, side_b) = pairs(surface, step), pairs(side, step)
        count += int(np.count_nonzero(~set_a & ~set_b & (side_a != side_b)))
    return count


def inside(mesh: NDArray[np.int64], snap_bits: int, edge: int, ties: str) -> Grid:
    """Whether the voxel's centre is inside all planes of a convex mesh, moved by d."""
    axis = (2 * np.arange(edge, dtype=np.int64) + 1) << (snap_bits - 1)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij", sparse=True)
    result = np.ones((edge,) * 3, bool)
    for triangle in mesh.tolist():
        n, a = oracle.normal_of(triangle), triangle[0]
        height = n[0] * (x - a[0]) + n[1] * (y - a[1]) + n[2] * (z - a[2])
        lead = next((c for c in n if c), 0)  # a tie: height - n.d has the sign of -lead
        result &= (height < 0) | ((height == 0) & (lead > 0 and ties == "one-sided"))
    return result


def flooded(surface: Grid, steps: list[Step]) -> Grid:
    """The unset voxels that paths of these steps from the corner (0, 0, 0) reach.

    Swept slice by slice along each axis, to and fro, until nothing is added: a few rounds, where a
    flood step by step takes one for each voxel of the longest path.
    """
    reached = np.zeros_like(surface)
    reached[0, 0, 0] = not surface[0, 0, 0]
    before = -1
    while before != (before := int(np.count_nonzero(reached))):
        for axis in range(3):
            # Contiguous slices: strided ones of 512^2 took most of the time.
            front = np.ascontiguousarray(np.moveaxis(reached, axis, 0))
            walls = np.ascontiguousarray(np.moveaxis(surface, axis, 0))
            for rows in (range(1, len(front)), range(len(front) - 2, -1, -1)):
                for i in rows:
                    came = front[i - rows.step]
                    front[i] |= (came if len(steps) == 3 else widened(came)) & ~walls[i]
            reached = np.moveaxis(front, 0, axis)
    return reached


def widened(slice_: Grid) -> Grid:
    """Every cell with its eight neighbours."""
    wide = slice_.copy()
    wide[1:] |= slice_[:-1]
    wide[:-1] |= slice_[1:]
    result = wide.copy()
    result[:, 1:] |= wide[:, :-1]
    result[:, :-1] |= wide[:, 1:]
    return result
