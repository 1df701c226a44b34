"""Damaged files by the thousand, read in processes of their own, so that nothing they do goes unseen."""

from __future__ import annotations

import multiprocessing
import os
import resource
import shutil
import signal
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.reports import Report
from panoloc_mcl.laboratory.studies.robustness.fuzz.inputs import Input, originals
from panoloc_mcl.laboratory.studies.robustness.fuzz.mutations import mutated
from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.progress import Progress, no_progress

# An input may take this long, and its process so much memory beside what it has.
_MOST_S, _MOST_MB = 10.0, 1024
# In one process, one after the other; and seconds without a word after which it is called hung.
_BATCH, _SILENT_S = 500, 60.0


@dataclass
class Tally:
    """What became of the inputs of one kind."""

    inputs: int = 0
    read: int = 0
    refused: int = 0
    #: By what was raised and where.
    failures: Counter[str] = field(default_factory=Counter)
    #: The number of one input of each failure: the same seed and number damage it in the same way.
    examples: dict[str, int] = field(default_factory=dict)


def study(
    inputs: int = 2000,
    seed: int = 0,
    extra: Iterable[Path] = (),
    progress: Progress = no_progress,
    patterns: Sequence[str] = ("*",),
) -> Report:
    """Damage files of every kind and read them.

    Parameters
    ----------
    inputs : int
        Over all kinds.
    seed : int
    extra : iterable of Path
        Calibration files of other tools.
    progress : callable (done, total, what)
    patterns : sequence of str
        Of the kinds that are damaged; the same inputs of them, whatever others there are.

    Raises
    ------
    ConfigError
        No kind has such a name.
    """
    tallies = fuzz(inputs, seed, extra, progress, patterns)
    report = Report(
        f"{sum(tally.inputs for tally in tallies.values())} damaged files, seed {seed}. "
        "Each is read, or refused by known errors of one line each. Failures: any other error, "
        f"more than {_MOST_S:g} s, {_MOST_MB} MB more than before, a process that dies, a file that was not there before."
    )
    table = report.table("What became of them", ("kind", "inputs", "read all the same", "refused in a line", "failures"))
    failed = report.table("Failures", ("kind", "what", "times", "one of them is number"))
    for kind, tally in tallies.items():
        table.add(kind, tally.inputs, tally.read, tally.refused, tally.failures.total())
        for what, count in tally.failures.most_common():
            failed.add(kind, what, count, tally.examples[what])
    table.add(
        "all",
        *(sum(getattr(t, name) for t in tallies.values()) for name in ("inputs", "read", "refused")),
        sum(t.failures.total() for t in tallies.values()),
    )
    return report


def fuzz(
    inputs: int,
    seed: int,
    extra: Iterable[Path] = (),
    progress: Progress = no_progress,
    patterns: Sequence[str] = ("*",),
) -> dict[str, Tally]:
    """Damage and read; the tally of every kind."""
    with tempfile.TemporaryDirectory(prefix="panoloc_fuzz_") as place:
        good = Path(place) / "good"
        good.mkdir()
        kinds = originals(good, extra)
        asked = {kind.kind for kind in kinds if any(fnmatchcase(kind.kind, pattern) for pattern in patterns)}
        if not asked:
            raise ConfigError(f"--kinds {' '.join(patterns)}: no such kind; known: {', '.join(kind.kind for kind in kinds)}")
        for kind in kinds:
            # A file that is refused before it is damaged would hide everything.
            kind.read(good, kind.files[0])
        # Evenly, the first kinds one more if it does not divide.
        counts = {kind.kind: inputs // len(kinds) + (number < inputs % len(kinds)) for number, kind in enumerate(kinds)}
        tallies = {kind.kind: Tally() for kind in kinds if kind.kind in asked}
        done, total = 0, sum(counts[name] for name in tallies)
        for kind in kinds:
            for begin in range(0, counts[kind.kind] if kind.kind in asked else 0, _BATCH):
                numbers = range(begin, min(begin + _BATCH, counts[kind.kind]))
                _batch(kind, good, Path(place) / "work", seed, numbers, tallies[kind.kind])
                done += len(numbers)
                progress(done, total, f"fuzz, {kind.kind}")
    return tallies


def _batch(kind: Input, good: Path, work: Path, seed: int, numbers: range, tally: Tally) -> None:
    """Inputs by number in processes of their own: after one that dies, the next goes on behind the input that killed it."""
    context = multiprocessing.get_context("fork")
    left = list(numbers)
    while left:
        shutil.rmtree(work, ignore_errors=True)
        shutil.copytree(good, work)
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_read_all, args=(kind, work, seed, left, theirs))
        process.start()
        theirs.close()
        while left:
            try:
                found = ours.recv() if ours.poll(_SILENT_S) else "hangs"
            except EOFError:
                process.join()
                found = f"process ended with {process.exitcode}"
            number = left.pop(0)
            tally.inputs += 1
            tally.read += found == "read"
            tally.refused += found == "refused"
            if found not in ("read", "refused"):
                tally.failures[found] += 1
                tally.examples.setdefault(found, number)
            if found == "hangs" or found.startswith("process ended"):
                break
        process.kill()
        process.join()
        ours.close()


def _read_all(kind: Input, work: Path, seed: int, numbers: list[int], answers: Connection) -> None:
    """In the process of a batch: say of each input what became of it."""
    os.chdir(work)
    warnings.simplefilter("ignore")
    used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + _MOST_MB * 2**20, resource.RLIM_INFINITY))
    # What libraries print of damaged files is not asked for.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    contents = [(work / file).read_bytes() for file in kind.files]
    there = _files(work.parent)
    for number in numbers:
        rng = np.random.default_rng([seed, number, *kind.kind.encode()])
        which, other = int(rng.integers(len(kind.files))), int(rng.integers(len(kind.files)))
        file = work / kind.files[which]
        file.write_bytes(mutated(contents[which], rng, contents[other]))
        found = _became(kind, work, kind.files[which])
        file.write_bytes(contents[which])
        if (now := _files(work.parent)) != there:
            found, there = f"wrote {', '.join(sorted(now - there))}", now
        answers.send(found)


def _became(kind: Input, work: Path, file: Path) -> str:
    try:
        with _limited(_MOST_S):
            kind.read(work, file)
    except PanolocError as error:
        return (
            "refused"
            if error.faults and all(fault and "\n" not in fault for fault in error.faults)
            else "refused without a word"
        )
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:80]!r} in {Path(where.filename).name}:{where.lineno}"
    return "read"


def _files(folder: Path) -> set[str]:
    return {str(path) for path in folder.rglob("*")}


@contextmanager
def _limited(seconds: float) -> Any:
    def stop(_: int, __: FrameType | None) -> None:
        raise TimeoutError(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
