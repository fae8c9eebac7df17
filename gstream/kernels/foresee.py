"""What triangles will take as voxels and in cells, told from their areas and extents alone."""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel

F64 = NDArray[np.float64]

SMALL_VOXELS, LARGE_VOXELS, SMALL_CELLS, LARGE_CELLS = 0, 1, 2, 3  # what is summed


@kernel
def foresee(
    points: F64, triangles: NDArray[np.integer], cell: float, thin: bool, sums: F64
) -> None:
    """Add up voxels and cells of small triangles, whose extents are below half a cell, and others.

    points : (v, 3) f8   in voxels
    triangles : (n, 3) integers   rows of points
    cell : edge of a cell, voxels
    thin : 6-separating voxels, not all that are met
    sums : (4,) f8   by the numbers above, added to
    source : a plane of unit normal n has max |n| thin voxels a voxel face of area, |x| + |y| + |z|
        that it meets
    """
    for t in range(triangles.shape[0]):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        x, y, z = points[a, 0], points[a, 1], points[a, 2]
        e_x, e_y, e_z = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
        f_x, f_y, f_z = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
        along_x = abs(e_y * f_z - e_z * f_y) / 2
        along_y = abs(e_z * f_x - e_x * f_z) / 2
        along_z = abs(e_x * f_y - e_y * f_x) / 2
        faces = along_x + along_y + along_z
        voxels = max(along_x, along_y, along_z) if thin else faces
        wide = max(e_x, f_x, 0.0) - min(e_x, f_x, 0.0)
        long = max(e_y, f_y, 0.0) - min(e_y, f_y, 0.0)
        deep = max(e_z, f_z, 0.0) - min(e_z, f_z, 0.0)
        if max(wide, long, deep) < cell / 2:
            sums[SMALL_VOXELS] += voxels
            sums[SMALL_CELLS] += (1 + wide / cell) * (1 + long / cell) * (1 + deep / cell)
        else:
            sums[LARGE_VOXELS] += voxels
            sums[LARGE_CELLS] += faces / cell**2 + (wide + long + deep) / cell + 1
