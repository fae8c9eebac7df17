"""Kernels: arrays in, arrays out. They know no file, no job and no other part of gstream."""

from collections.abc import Callable, Sequence
from dis import get_instructions
from typing import Any, TypeVar, cast

from numba import njit, types
from numba.core.registry import CPUDispatcher

F = TypeVar("F", bound=Callable[..., Any])

PART_OPTIONS = {
    "nopython": True,
    "nogil": True,
    "error_model": "numpy",
    "_nrt": False,
    "no_cfunc_wrapper": True,
}


def kernel(function: F) -> F:
    """Compile a top-level function with numba, cached on disk; never parallel, never fastmath."""
    options = {"nogil": True, "cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    compiled: F = njit(**options)(function)
    return compiled


def part(function: F) -> F:
    """Compile a piece that kernels call often: no reference counts, so it cannot allocate.

    Without them a call with array arguments costs nothing atomic: the inner loops of the voxelizer
    ran 1.2 to 1.6 times faster. On disk it is cached only inside the kernels that call it.
    """
    has_loop = any(step.opname == "FOR_ITER" for step in get_instructions(function))
    dispatcher = CPUDispatcher if has_loop else _OneForAllConstants
    return cast(F, dispatcher(function, {}, PART_OPTIONS))


class _OneForAllConstants(CPUDispatcher):  # type: ignore[misc]  # numba has no types
    """Compiles a part once for all constant arguments; numba does so for each set of them.

    A part without a loop gets its constants when it is inlined. A loop is turned into vector
    instructions before that: with one copy for all, small triangles took 1.05 times as long.
    """

    def get_call_template(self, args: Sequence[Any], kws: dict[str, Any]) -> Any:
        """Resolve a call as numba does, a constant's type being that of any such number."""
        general = {name: types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template([types.unliteral(kind) for kind in args], general)
