"""Repeating a run from what its results folder keeps, and telling whether the same came out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from panoloc_mcl.tools.report import Results
from panoloc_mcl.tools.report.results import layout
from panoloc_mcl.tools.runs.info import versions


def is_run_info(path: Path) -> bool:
    """Whether a path is the ``run.json`` of a results folder, and no configuration."""
    return path.name == layout.RUN_INFO


def other_versions(results: Results) -> str:
    """What has other versions than when the run was made: ``numpy 2.1.0, now 2.4.6``; empty if nothing has."""
    then = results.run_info.get("versions")
    then = then if isinstance(then, Mapping) else {}
    return ", ".join(f"{name} {then[name]}, now {now}" for name, now in versions().items() if then.get(name, now) != now)


def compared(results: Results, again: Path) -> str:
    """One line that says whether a repeated run gave the same trajectories.

    Parameters
    ----------
    results : Results
        The run that was repeated.
    again : Path
        Results folder of the repetition.
    """
    runs = [layout.run_folder(record.name, record.run) for record in results.records]
    pairs = [(results.path / run / layout.TRAJECTORY, again / run / layout.TRAJECTORY) for run in runs]
    made = [(first, second) for first, second in pairs if second.exists()]
    same = sum(first.read_bytes() == second.read_bytes() for first, second in made)
    return f"{same} of {len(made)} trajectories have the same bytes as in {results.path}"
