"""Locks of objects that threads share; a copy of such an object, be it made by pickle or by ``copy``, gets a lock of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from types import TracebackType
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")


class Lock:
    """One thread at a time, which may enter again."""

    def __init__(self) -> None:
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._lock.release()

    def __reduce__(self) -> tuple[type[Lock], tuple[()]]:
        return Lock, ()


def locked(method: Callable[P, R]) -> Callable[P, R]:
    """A method of an object with a `Lock` in ``_lock`` that one thread at a time is in."""

    @wraps(method)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        with cast(Any, args[0])._lock:
            return method(*args, **kwargs)

    return guarded
