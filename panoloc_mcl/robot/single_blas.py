"""One BLAS thread while the localizer works: products this small gain nothing from more, and sums come out the same on every machine.

The number of threads belongs to the whole process, in which other localizers and the host's own code work at the same time. So the
first that comes lowers it and the last that goes puts it back.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import threadpoolctl
from threadpoolctl import ThreadpoolController


class _Limit:
    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.workers = 0
        self.controller: ThreadpoolController | None = None
        self.before: Any = None


_limit = _Limit()


def _begin_anew() -> None:
    """A forked process has none of the threads that were at work, and must not wait for their lock."""
    global _limit
    _limit = _Limit()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """While anybody is inside, BLAS uses one thread; afterwards as many as before."""
    limit = _limit
    with limit.lock:
        limit.workers += 1
        if limit.workers == 1:
            limit.controller = limit.controller or ThreadpoolController()
            limit.before = limit.controller.limit(limits=1, user_api="blas")
    try:
        yield
    finally:
        with limit.lock:
            limit.workers -= 1
            if limit.workers == 0 and _all_single(limit.controller):
                # Only the thread that lowered it may put it back, says threadpoolctl from 3.7 on; that thread may have gone before.
                _disown()
                limit.before.restore_original_limits()
                _disown()


def _all_single(controller: ThreadpoolController | None) -> bool:
    """Whether the limit took effect; where the host holds one of its own, it did not."""
    return controller is not None and all(
        library["num_threads"] == 1 for library in controller.info() if library["user_api"] == "blas"
    )


def _disown() -> None:
    disown = getattr(getattr(threadpoolctl, "OpenBLASController", None), "clear_controlling_thread", None)
    if disown is not None:
        disown(force=True)
