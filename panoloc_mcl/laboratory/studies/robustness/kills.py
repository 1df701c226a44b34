"""Commands that are killed at random moments: what they leave behind is whole, and the next start finishes."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from panoloc_mcl.laboratory.reports import Report
from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.robot.files import CACHE_VARIABLE
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.validation import read_yaml
from panoloc_mcl.tools.datasets import read_tum

#: What the commands work on: a small room, rendered within seconds.
SIMULATION = """\
name: closet
scene: closet
references_light: day
size: [90, 36]
rendering: {samples: 8}
sensor: {samples: 1}
sequences:
  - {name: day, light: day, frames: 12, every_s: 1.0}
  - {name: lamp, light: lamp, frames: 12, every_s: 1.0}
"""
COMPARISON = """\
format: panoloc-comparison/1
name: killed
datasets: [data]
modes: {monte_carlo: {}, odometry_only: {initial: known_pose}}
seeds: 2
"""
#: What each command writes, and its words after ``panoloc``.
COMMANDS: dict[str, tuple[str, ...]] = {
    "simulate": ("simulate", "closet.yaml", "-o", "killed/data"),
    "build-map": ("build-map", "data", "-o", "killed/closet.panomap"),
    "run": ("run", "run.yaml"),
    "compare": ("compare", "compare.yaml", "--out", "killed/compared"),
}
# After every so many kills the command may finish, and what it writes begins anew.
_FINISH_EVERY = 10
# So many times as many kills as are asked for may come too late.
_MOST_TOO_LATE = 3


@dataclass
class Tally:
    """What happened to one command."""

    kills: int = 0
    too_late: int = 0
    damaged: int = 0
    restarts: int = 0
    finished: int = 0


def study(
    kills: int = 200, seed: int = 0, commands: Sequence[str] = tuple(COMMANDS), progress: Progress = no_progress
) -> Report:
    """Kill commands with SIGKILL, in turns, and look at every file that is left.

    Parameters
    ----------
    kills : int
        Over all commands.
    seed : int
        Of the moments.
    commands : sequence of str
        Of `COMMANDS`.
    progress : callable
        Is told how many were killed.

    Returns
    -------
    Report
        A row for each command: kills that met it at work, those that came too late and do not count, files that were not whole,
        starts afterwards, and how many of them finished.
    """
    rng = np.random.default_rng(seed)
    tallies = {name: Tally() for name in commands}
    with tempfile.TemporaryDirectory(prefix="panoloc_kills_") as folder:
        work = Path(folder)
        _prepare(work)
        lasts = {name: _duration(name, work) for name in commands}
        for count in range(kills):
            name = commands[count % len(commands)]
            tally = tallies[name]
            while not _killed(name, work, float(rng.uniform(0.2, 1.0)) * lasts[name]):
                # It had ended, maybe as what was left of it was soon done: it begins anew.
                tally.too_late += 1
                if tally.too_late > _MOST_TOO_LATE * kills:
                    raise PanolocError(f"panoloc {name}: ends before it can be killed; is the machine busy with other work?")
                tally.damaged += len(damaged(work))
                _clear(work)
            tally.kills += 1
            tally.damaged += len(damaged(work))
            if tally.kills % _FINISH_EVERY == 0 or count + len(commands) >= kills:
                tally.restarts += 1
                # A data set that was whole when its process was killed is there already: it is refused to be overwritten.
                whole = name == "simulate" and (work / "killed" / "data" / "dataset.yaml").is_file()
                tally.finished += _start(name, work).wait() == 0 or whole
                tally.damaged += len(damaged(work))
                _clear(work)
            progress(count + 1, kills, "kills")
    report = Report(f"{kills} times SIGKILL at a random moment (seed {seed}), then a new start.")
    table = report.table("", ("command", "killed at work", "had ended", "files not whole", "new starts", "finished"))
    for name, tally in tallies.items():
        table.add(f"panoloc {name}", tally.kills, tally.too_late, tally.damaged, tally.restarts, tally.finished)
    return report


def damaged(folder: Path) -> list[Path]:
    """Files under a folder that are not whole, told by reading each; unfinished ones, whose name begins with a dot, do not count."""
    return [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.startswith(".") and not _whole(path)]


def _whole(path: Path) -> bool:
    look = _LOOKS.get(path.suffix)
    try:
        return look is None or look(path)
    except (PanolocError, ValueError, OSError, KeyError, EOFError, zipfile.BadZipFile):
        return False


def _is_table(path: Path) -> bool:
    text = path.read_text(encoding="utf-8")
    return text.endswith("\n") and len({len(row) for row in csv.reader(io.StringIO(text))}) == 1


def _is_archive(path: Path) -> bool:
    with np.load(path, allow_pickle=False) as arrays:
        return all(arrays[name] is not None for name in arrays.files)


_LOOKS: dict[str, Callable[[Path], bool]] = {
    ".json": lambda path: json.loads(path.read_text(encoding="utf-8")) is not None,
    ".yaml": lambda path: bool(read_yaml(path)),
    ".csv": _is_table,
    ".tum": lambda path: len(read_tum(path)) > 0,
    ".png": lambda path: cv2.imread(str(path), cv2.IMREAD_UNCHANGED) is not None,
    ".panomap": lambda path: bool(PanoramaMap.load(path).name),
    ".npz": _is_archive,
    ".html": lambda path: path.read_text(encoding="utf-8").rstrip().endswith("</html>"),
}


def _prepare(work: Path) -> None:
    (work / "closet.yaml").write_text(SIMULATION, encoding="utf-8")
    (work / "compare.yaml").write_text(COMPARISON, encoding="utf-8")
    (work / "run.yaml").write_text("name: killed\ndataset: data\nout: killed/results\n", encoding="utf-8")
    _finish(("simulate", "closet.yaml", "-o", "data"), work)


def _duration(name: str, work: Path) -> float:
    """Seconds that a command takes when nobody kills it, the second time: kernels are compiled and light is carried by then."""
    took = 0.0
    for _ in range(2):
        started = time.monotonic()
        _finish(COMMANDS[name], work)
        took = time.monotonic() - started
        _clear(work)
    return took


def _finish(words: tuple[str, ...], work: Path) -> None:
    process = _popen(words, work, stderr=subprocess.PIPE)
    _, said = process.communicate()
    if process.returncode != 0:
        raise PanolocError(
            f"panoloc {' '.join(words)}: ended with {process.returncode} before anything was killed: {said[-500:]!r}"
        )


def _killed(name: str, work: Path, after_s: float) -> bool:
    """Start a command and kill it after so long; whether it was still at work."""
    process = _start(name, work)
    try:
        process.wait(after_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return True
    return False


def _start(name: str, work: Path) -> subprocess.Popen[bytes]:
    return _popen(COMMANDS[name], work, stderr=subprocess.DEVNULL)


def _popen(words: tuple[str, ...], work: Path, stderr: int) -> subprocess.Popen[bytes]:
    # Paths that Python finds the package on may be relative.
    paths = os.pathsep.join(str(Path(entry).resolve()) for entry in sys.path if entry)
    environment = os.environ | {CACHE_VARIABLE: str(work / "cache"), "PYTHONPATH": paths}
    return subprocess.Popen(
        [sys.executable, "-m", "panoloc_mcl", *words], cwd=work, env=environment, stdout=subprocess.DEVNULL, stderr=stderr
    )


def _clear(work: Path) -> None:
    """Remove what the commands wrote, and the maps that are kept; carried light stays."""
    shutil.rmtree(work / "killed", ignore_errors=True)
    shutil.rmtree(work / "cache" / "maps", ignore_errors=True)
