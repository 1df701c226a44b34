"""Where cells run: in this process, or on the workers of Dask, here or elsewhere. Needs the extra ``distributed`` for the latter."""

from __future__ import annotations

import importlib.util
import logging
import platform
from asyncio import CancelledError
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any, Protocol

from panoloc_mcl import __version__
from panoloc_mcl.laboratory.comparison.cell import Job, attempt, code_digest, prepare
from panoloc_mcl.laboratory.comparison.runs import Failure, Runs
from panoloc_mcl.robot.errors import PanolocError

_CONNECT_S = 10
# A worker that dies costs its cell another try; a cell that takes down so many workers is at fault itself.
_RETRIES = 3
# Every image needs the same few megabytes again. Dask tells its workers to give memory back at once, and two workers that fetch it
# anew for each image are slower than one process.
_KEEP_MEMORY = {"MALLOC_TRIM_THRESHOLD_": 1 << 30, "MALLOC_MMAP_THRESHOLD_": 1 << 30}


class EngineError(PanolocError):
    """The engine cannot run cells: a scheduler out of reach, a worker without the data or with another version."""


class Engine(Protocol):
    """Runs jobs in any order."""

    def run(self, jobs: Sequence[Job]) -> Iterator[tuple[Job, Runs | Failure]]:
        """Each job with what it gave, as soon as it is known."""


class InProcess:
    """One cell after the other, here."""

    def run(self, jobs: Sequence[Job]) -> Iterator[tuple[Job, Runs | Failure]]:
        """Each job in turn."""
        for job in jobs:
            yield job, attempt(job)


@contextmanager
def open_engine(workers: int | None = None, scheduler: str | None = None) -> Iterator[Engine]:
    """The engine that was asked for; closed in the end, whatever happens.

    Parameters
    ----------
    workers : int, optional
        So many local worker processes.
    scheduler : str, optional
        Address of a running scheduler, such as ``tcp://host:8786``; its workers must have this package and the data sets.

    Raises
    ------
    EngineError
        Both given, no such number of workers, a scheduler that cannot be reached, or Dask is not installed.
    """
    if workers is None and scheduler is None:
        yield InProcess()
        return
    if workers is not None and scheduler is not None:
        raise EngineError("--workers and --scheduler: a scheduler has its own workers; give one of the two")
    if workers is not None and not 1 <= workers <= 1024:
        raise EngineError(f"--workers {workers}: must be from 1 to 1024; 1 a core is most that pays")
    if importlib.util.find_spec("distributed") is None:
        raise EngineError('--workers and --scheduler need Dask; install it: pip install "panoloc-mcl[distributed]"')
    with _quiet(), _client(workers, scheduler) as client:
        yield OnDask(client, scheduler)


class OnDask:
    """On the workers of a Dask client; which cell runs where is Dask's business.

    Parameters
    ----------
    client : distributed.Client
    scheduler : str or None
        Its address if it is not a local one.
    """

    def __init__(self, client: Any, scheduler: str | None) -> None:
        self._client, self._scheduler = client, scheduler

    def run(self, jobs: Sequence[Job]) -> Iterator[tuple[Job, Runs | Failure]]:
        """Maps first, each once, and every cell as soon as there is its map; then as they finish.

        Raises
        ------
        EngineError
            No workers, workers of another version or without the data, a scheduler that went away.
        """
        where = f"scheduler {self._scheduler or 'here'}"
        try:
            yield from self._finished(jobs)
        except (OSError, CancelledError) as error:
            again = "start it and give the same command again: finished cells are kept"
            raise EngineError(f"{where}: went away; {again}") from error

    def _finished(self, jobs: Sequence[Job]) -> Iterator[tuple[Job, Runs | Failure]]:
        """The same; an `OSError` or `CancelledError` when the scheduler went away."""
        from distributed import as_completed

        self._check_workers()
        maps: dict[str, Any] = {}
        futures: dict[Any, Job] = {}
        for job in jobs:
            if job.map not in maps:
                maps[job.map] = self._client.submit(prepare, job, pure=False, retries=_RETRIES)
            future = self._client.submit(_after, maps[job.map], job, pure=False, retries=_RETRIES)
            futures[future] = job
        for future in as_completed(futures, raise_errors=False):
            job = futures.pop(future)
            if future.status == "finished":
                yield job, future.result()
            elif future.status == "error":
                # Whatever goes wrong in a cell is a result; this is a cell that took all its workers down.
                error = future.exception()
                yield job, Failure(" ".join(f"{type(error).__name__}: {error}".split()))
            else:
                raise CancelledError
            future.release()

    def _check_workers(self) -> None:
        where = f"scheduler {self._scheduler}"
        found = self._client.run(_version)
        if not found:
            raise EngineError(f"{where}: has no workers; start one with: dask worker {self._scheduler} --nthreads 1")
        mine = _version()
        faults = [
            f"worker {worker}: has {theirs}, the comparison was started with {mine}; install the same on both"
            for worker, theirs in sorted(found.items())
            if theirs != mine
        ]
        if faults:
            raise EngineError(faults)


def _after(prepared: None, job: Job) -> Runs | Failure:
    return attempt(job)


def _version() -> str:
    """Of all that the figures depend on to the last bit."""
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba"))
    return f"panoloc-mcl {__version__} (code {code_digest()}), {libraries}, {platform.machine()}"


@contextmanager
def _client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    import dask
    from distributed import Client, LocalCluster

    if scheduler is None:
        with (
            dask.config.set({f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in _KEEP_MEMORY.items()}),
            LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=logging.CRITICAL
            ) as cluster,
            Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = Client(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError) as error:
        raise EngineError(
            f"--scheduler {scheduler}: cannot be reached ({_first_line(error)}); start one with 'dask scheduler' and give the address "
            "that it prints"
        ) from error
    with client:
        yield client


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


@contextmanager
def _quiet() -> Iterator[None]:
    """What Dask logs about workers that die and retries is no concern of the user's: it mends that itself."""
    # Sets the levels of its loggers when it is imported.
    import distributed  # noqa: F401

    names = [
        name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado", "asyncio")
    ]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
