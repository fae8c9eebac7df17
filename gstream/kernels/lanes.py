"""Rows of lanes: one value for each of 64 triangles side by side, in flat arrays.

Rows stand at constant places of one array per type: so the compiler can prove that two of them do
not overlap, and turns a loop over a row into vector instructions.
"""

import numpy as np

from gstream.kernels import part

LANES = 64  # of 16 to 128, 64 was fastest: rows of 8 KB in all, and loops long enough to start up


@part
def at(row: int, lane: int) -> np.uint64:
    """Place of a row's lane; unsigned, since a signed index costs a test for negative ones."""
    return np.uint64(row * LANES + lane)
