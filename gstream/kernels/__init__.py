"""Kernels: arrays in, arrays out. They know no file, no job and no other part of gstream."""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a top-level function with numba, cached on disk; never parallel, never fastmath."""
    compiled: F = njit(nogil=True, cache=True)(function)
    return compiled
