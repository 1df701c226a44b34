"""All Numba policy in one place.

Kernels are compiled at their first call, never at import, and cached on disk. ``error_model="numpy"`` lets a division by zero give
infinity as in NumPy. No kernel may reorder sums or take NaN for impossible (``fastmath``), so NaN checks hold. What works on every
particle or pixel is declared a `vector_kernel`: there alone a product and a sum may be rounded once instead of twice (``contract``),
and the sign of zero is free (``nsz``), which makes polynomials a third faster and never less exact. Kernels release the interpreter's
lock, so threads are those of Python (`panoloc_mcl.robot.filters.particles.blocks`).
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

_THREADS = "NUMBA_NUM_THREADS"
if not os.environ.get(_THREADS, "1").strip().isdigit() or int(os.environ.get(_THREADS, "1")) < 1:
    # Numba would end the process with a traceback at import.
    warnings.warn(
        f"{_THREADS} = '{os.environ.pop(_THREADS)}' is no number of threads and not used", RuntimeWarning, stacklevel=1
    )

import numba  # noqa: E402
from numba.core.caching import FunctionCache  # noqa: E402

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}
_FUSED: dict[str, Any] = {"fastmath": {"nsz", "contract"}}
_warned = False


def kernel(function: Function) -> Function:
    """Compile a pure function of arrays and scalars; without a writable cache folder, compile it anew in every process."""
    return _compiled(function, _OPTIONS)


def vector_kernel(function: Function) -> Function:
    """As `kernel`, for loops that the compiler turns into vector instructions; see above for what it may round."""
    return _compiled(function, {**_OPTIONS, **_FUSED})


def inlined(function: Function) -> Function:
    """A small function of scalars that becomes part of every kernel that calls it: only then are several worked out at once."""
    compiled: Function = numba.njit(forceinline=True, **_OPTIONS, **_FUSED)(function)
    return compiled


def _compiled(function: Function, options: dict[str, Any]) -> Function:
    try:
        compiled: Function = numba.njit(cache=True, **options)(function)
    except (RuntimeError, OSError):
        # Numba finds no folder it may write to: neither beside the package nor in the user's cache.
        _warn("no writable folder for compiled kernels; set NUMBA_CACHE_DIR to keep them")
        compiled = numba.njit(**options)(function)
    if isinstance(cache := getattr(compiled, "_cache", None), FunctionCache):
        compiled._cache = _ForgivingCache(cache)  # type: ignore[attr-defined]
    return compiled


class _ForgivingCache:
    """Numba's cache of a kernel, but a full disk or a damaged file costs a warning and the time to compile, never the run."""

    def __init__(self, cache: Any) -> None:
        self._cache = cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            found = self._cache.load_overload(sig, target_context)
            # Two processes that compile a kernel for different types at once may name their files alike, and one overwrites the other.
            if found is not None and tuple(found.signature.args) != tuple(getattr(sig, "args", sig)):
                raise TypeError(f"kept for {found.signature.args}, asked for {sig}")
            return found
        except Exception as error:
            _warn(
                f"compiled kernels in {self._cache.cache_path} are damaged ({error}) and compiled again; delete them if this lasts"
            )
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            self._cache.save_overload(sig, data)
        except Exception as error:
            _warn(f"compiled kernels are not kept in {self._cache.cache_path} ({error}); make room, or set NUMBA_CACHE_DIR")


def _warn(text: str) -> None:
    global _warned
    if not _warned:
        warnings.warn(text, RuntimeWarning, stacklevel=4)
        _warned = True
