"""How long work reports that it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Called with (done, total, what).
Progress = Callable[[int, int, str], None]


def no_progress(done: int, total: int, what: str) -> None:
    """Report nothing."""


@contextmanager
def timed(stage_ms: dict[str, float], stage: str) -> Iterator[None]:
    """Put down how many milliseconds a stage took."""
    begin = time.perf_counter()
    try:
        yield
    finally:
        stage_ms[stage] = 1e3 * (time.perf_counter() - begin)
