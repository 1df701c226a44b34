"""All Numba policy in one place.

Kernels are compiled at their first call, never at import, and cached on disk. ``error_model="numpy"`` lets a division by zero give
infinity as in NumPy; there is no ``fastmath``, so NaN checks hold.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_warned = False


def kernel(function: Function) -> Function:
    """Compile a pure function of arrays and scalars; without a writable cache folder, compile it anew in every process."""
    global _warned
    try:
        compiled: Function = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    except RuntimeError:
        # Numba finds no folder it may write to: neither beside the package nor in the user's cache.
        if not _warned:
            warnings.warn(
                "no writable folder for compiled kernels; set NUMBA_CACHE_DIR to keep them", RuntimeWarning, stacklevel=2
            )
            _warned = True
        compiled = numba.njit(error_model="numpy", nogil=True)(function)
    return compiled
