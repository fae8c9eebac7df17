"""Snapping vertices to the integer lattice of a grid, once, as a pure function of the vertex."""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel


@kernel
def snap(
    positions: NDArray[np.floating],
    origin: NDArray[np.float64],
    scale: float,
    snapped: NDArray[np.int64],
) -> None:
    """Snap world positions to multiples of voxel_size / 2^k.

    positions : (n, 3) f4 or f8   finite, world units
    origin : (3,) f8   world position of the grid's low corner
    scale : float   2^k / voxel_size
    snapped : (n, 3) i8   out: floor((x - origin) * scale + 1/2)
    returns : nothing
    errors : none; the grid's snap budget keeps every result within 2^27
    source : numerics.md section 2
    """
    for i in range(positions.shape[0]):
        for c in range(3):
            snapped[i, c] = np.int64(
                np.floor((np.float64(positions[i, c]) - origin[c]) * scale + 0.5)
            )
