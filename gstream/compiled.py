"""The compiled form of the block file's arithmetic, and when it pays.

The same bits as the NumPy form (gstream/formats/arithmetic.py), several times faster.
"""

from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gstream.formats.arithmetic import PLAIN, Arithmetic, Choice
from gstream.formats.batches import BatchKernels
from gstream.formats.lodrule import COLOUR_TABLES, U8, U16, U32, Reduced


@cache
def _compiled() -> Arithmetic:
    from gstream.kernels import filters, lod, morton, octahedral, octree

    def decode_morton(codes: NDArray[Any]) -> U32:
        places: U32 = morton.decode_codes(codes).view(np.uint32)
        return places

    def reduce_runs(
        codes: NDArray[Any],
        mask: U8,
        normal: U16,
        colour: U8,
        weight: U32,
        bits: int,
        use_weight: bool,
    ) -> Reduced:
        return Reduced(
            *lod.reduce_runs(codes, mask, normal, colour, weight, bits, use_weight, COLOUR_TABLES)
        )

    return Arithmetic(
        filters,
        decode_morton,
        morton.bounds_of_each,
        octahedral.decode_normals,
        octahedral.all_canonical,
        reduce_runs,
        BatchKernels(filters.undo_filters, octree.decode_octrees),
    )


def compiled(_: int = 0) -> Arithmetic:
    """Compiled from the first voxel to the last."""
    return _compiled()


def after(voxels: int) -> Choice:
    """NumPy for the first `voxels`, so that a glance at a file loads no compiler."""
    return lambda decoded: PLAIN if decoded <= voxels else _compiled()


# Loading takes 0.8 s, and compiling 15 s once after an installation; NumPy decodes 5 to 10 million
# voxels a second, and checks 0.6 million.
READING: Final = after(1 << 25)
CHECKING: Final = after(1 << 21)
