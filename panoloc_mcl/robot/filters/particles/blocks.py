"""Work on many particles a block at a time: what lies between two steps stays in the processor's cache, and threads share blocks.

Blocks are the same whatever the number of threads, so results are, too. Below some ten thousand particles threads cost more than
they save; they are asked for, never assumed.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

BLOCK = 32768


class Blocks:
    """Calls a function for each block of particles.

    Parameters
    ----------
    threads : int
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        # Made when it is first needed, by the process that needs it: threads do not live on in a fork, nor in a copy.
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0

    def __getstate__(self) -> dict[str, Any]:
        return {"threads": self.threads, "_pool": None, "_process": 0}

    def each(self, work: Callable[[slice], object], count: int) -> None:
        """``work(block)`` for slices that cover ``count`` particles; it writes its result itself."""
        blocks = [slice(start, min(start + BLOCK, count)) for start in range(0, count, BLOCK)]
        if self.threads == 1 or len(blocks) == 1:
            for block in blocks:
                work(block)
            return
        if self._pool is None or self._process != os.getpid():
            self._pool, self._process = ThreadPoolExecutor(self.threads, thread_name_prefix="particles"), os.getpid()
        # A list: errors in a thread are raised here.
        list(self._pool.map(work, blocks))
