"""Kernels: arrays in, arrays out. They know no file, no job and no other part of gstream."""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a top-level function with numba, cached on disk; never parallel, never fastmath."""
    compiled: F = njit(
        nogil=True, cache=True, error_model="numpy", no_cfunc_wrapper=True
    )(function)  # fmt: skip
    return compiled


def part(function: F) -> F:
    """Compile a piece that kernels call often: no reference counts, so it cannot allocate.

    Without them a call with array arguments costs nothing atomic: the inner loops of the voxelizer
    ran 1.2 to 1.6 times faster. Only kernels can call it: it has no wrapper for Python, and no file
    of its own in the cache; there were hundreds of both.
    """
    compiled: F = njit(
        nogil=True, error_model="numpy", _nrt=False, no_cfunc_wrapper=True, no_cpython_wrapper=True
    )(function)  # fmt: skip
    return compiled
