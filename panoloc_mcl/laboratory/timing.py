"""Times and memory, measured in turns so that a busy moment of the machine affects all alike; and the peer of the ratios."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits


class Spent(NamedTuple):
    """Seconds of each round of one task, float64 (rounds,): by the clock, and of the processor over all threads."""

    clock: NDArray[np.float64]
    processor: NDArray[np.float64]


def interleaved(tasks: Mapping[str, Callable[[], object]], rounds: int, warm_up: int = 1) -> dict[str, Spent]:
    """Times of tasks that are run in turn.

    Parameters
    ----------
    tasks : mapping of str to callable
    rounds : int
    warm_up : int
        Rounds before, which compile kernels and fill caches, and do not count.
    """
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in tasks}
    for index in range(warm_up + rounds):
        for name, task in tasks.items():
            clock, processor = time.perf_counter(), time.process_time()
            task()
            if index >= warm_up:
                spent[name].append((time.perf_counter() - clock, time.process_time() - processor))
    return {name: Spent(*np.array(times).T) for name, times in spent.items()}


@contextmanager
def one_thread() -> Iterator[None]:
    """Within it OpenCV and the libraries below NumPy work on one thread: times are those of a processor, on any machine."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        cv2.setNumThreads(before)


def memory_mb(*, peak: bool = True) -> float:
    """Resident memory of this process, megabytes: the largest so far, or that of now."""
    status = Path("/proc/self/status")
    if status.exists():
        # getrusage would count the process that this one was forked from.
        field = "VmHWM" if peak else "VmRSS"
        return float(next(line.split()[1] for line in status.read_text().splitlines() if line.startswith(field))) / 1024
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / (1024 * 1024 if sys.platform == "darwin" else 1024)


def in_a_process(function: str, *arguments: str, environment: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The figures that a function finds in a process of its own, and that process's peak memory as ``peak_mb``.

    Parameters
    ----------
    function : str
        ``module:name``; it takes texts and returns a mapping of plain values.
    *arguments : str
    environment : mapping, optional
        Variables of the process, instead of this one's.
    """
    code = (
        "import sys, json, importlib\n"
        "module, _, name = sys.argv[1].partition(':')\n"
        "found = getattr(importlib.import_module(module), name)(*sys.argv[2:])\n"
        "from panoloc_mcl.laboratory.timing import memory_mb\n"
        "print(json.dumps({**found, 'peak_mb': memory_mb()}))\n"
    )
    command = [sys.executable, "-c", code, function, *arguments]
    out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment).stdout
    return dict(json.loads(out.splitlines()[-1]))


def template_matching(image: NDArray[Any], references: NDArray[np.uint8]) -> Callable[[], object]:
    """OpenCV's normalised cross-correlation of a grey image (rows, columns) with every reference at every heading."""
    grey = np.clip(image, 0, 255).astype(np.uint8)
    wrapped = np.hstack([grey, grey[:, :-1]])
    return lambda: [cv2.matchTemplate(wrapped, reference, cv2.TM_CCOEFF_NORMED) for reference in references]


def matrix_product(size: int = 1024) -> tuple[Callable[[], object], float]:
    """What the machine can do: a product of float32 matrices, and how many operations it takes."""
    square = np.random.default_rng(0).standard_normal((size, size)).astype(np.float32)
    return lambda: square @ square, 2.0 * size**3
