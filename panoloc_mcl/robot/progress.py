"""How long work reports that it goes on."""

from __future__ import annotations

from collections.abc import Callable

#: Called with (done, total, what).
Progress = Callable[[int, int, str], None]


def no_progress(done: int, total: int, what: str) -> None:
    """Report nothing."""
