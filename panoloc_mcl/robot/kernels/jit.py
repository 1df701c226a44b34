"""All Numba policy in one place.

Kernels are compiled at their first call, never at import, and cached on disk. ``error_model="numpy"`` lets a division by zero give
infinity as in NumPy. No kernel may reorder sums or take NaN for impossible (``fastmath``), so NaN checks hold. What works on every
particle is declared a `vector_kernel`: there alone a product and a sum may be rounded once instead of twice (``contract``), and
the sign of zero is free (``nsz``), which makes polynomials a third faster and never less exact. Kernels release the interpreter's
lock, so threads are those of Python (`panoloc_mcl.robot.filters.blocks`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}
_FUSED: dict[str, Any] = {"fastmath": {"nsz", "contract"}}
_warned = False


def kernel(function: Function) -> Function:
    """Compile a pure function of arrays and scalars; without a writable cache folder, compile it anew in every process."""
    return _compiled(function, _OPTIONS)


def vector_kernel(function: Function) -> Function:
    """As `kernel`, for loops over particles that the compiler turns into vector instructions; see above for what it may round."""
    return _compiled(function, {**_OPTIONS, **_FUSED})


def inlined(function: Function) -> Function:
    """A small function of scalars that becomes part of every kernel that calls it: only then are several worked out at once."""
    compiled: Function = numba.njit(forceinline=True, **_OPTIONS, **_FUSED)(function)
    return compiled


def _compiled(function: Function, options: dict[str, Any]) -> Function:
    global _warned
    try:
        compiled: Function = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # Numba finds no folder it may write to: neither beside the package nor in the user's cache.
        if not _warned:
            warnings.warn(
                "no writable folder for compiled kernels; set NUMBA_CACHE_DIR to keep them", RuntimeWarning, stacklevel=3
            )
            _warned = True
        compiled = numba.njit(**options)(function)
    return compiled
