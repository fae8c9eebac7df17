"""What reading and checking blocks compute with: all of it in NumPy, or all of it compiled.

Both give the same bits. Here: the interface and its NumPy form; gstream/compiled.py has the other,
since formats know no compiler.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gstream.formats import filters
from gstream.formats.batches import BatchKernels
from gstream.formats.filters import Filters
from gstream.formats.lodrule import (
    U8,
    U16,
    U32,
    Reduced,
    all_canonical,
    decode_normals,
    reduce_runs,
)
from gstream.formats.morton import bounds_of_each, decode_morton


class Arithmetic(NamedTuple):
    """One form of the block file's arithmetic; each field as its namesake in gstream/formats."""

    filters: Filters
    decode_morton: Callable[[NDArray[Any]], U32]
    bounds_of_each: Callable[[U32, NDArray[np.int64]], U8]
    decode_normals: Callable[[U16, int], NDArray[np.int32]]
    all_canonical: Callable[[U16, int], bool]
    reduce_runs: Callable[[NDArray[Any], U8, U16, U8, U32, int, bool], Reduced]
    batches: BatchKernels | None  # what decodes many blocks at once; NumPy has nothing for it


# Given the voxels decoded so far, the form to go on with: loading compiled code takes a while.
Choice = Callable[[int], Arithmetic]

PLAIN: Final = Arithmetic(
    filters, decode_morton, bounds_of_each, decode_normals, all_canonical, reduce_runs, None
)


def plain(_: int = 0) -> Arithmetic:
    """NumPy from the first voxel to the last."""
    return PLAIN
