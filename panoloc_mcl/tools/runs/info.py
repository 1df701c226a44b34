"""What ``run.json`` says of a run: by which program, on which machine, with which settings."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.report.mending import drawn_graph, graph_lines


def run_info(config: RunConfig, dataset: Dataset, command: Sequence[str], keyframes: Keyframes) -> dict[str, Any]:
    """What ``run.json`` says of how a run came about."""
    return {
        "name": config.name,
        "dataset": dataset.name,
        "mode": config.localizer.mode,
        "model": config.observation.model,
        "map": dict(graph_lines(keyframes)),
        "graph": drawn_graph(keyframes),
        "initial": config.model_dump(mode="json")["localizer"]["initial"],
        "seed": config.seed,
        "runs": config.runs,
        "sequences": config.sequences,
        "kidnap_every_frames": config.kidnap.every_frames or None,
        "command": list(command),
        "started": datetime.now().isoformat(timespec="seconds"),
        "machine": {"system": platform.system(), "processor": platform.machine(), "cores": os.cpu_count()},
        "threads": _threads(),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Versions of Python, of this package and of the libraries that results depend on."""
    return {"python": platform.python_version()} | {name: _version(name) for name in _REPORTED}


def _threads() -> int:
    asked = os.environ.get("NUMBA_NUM_THREADS", "")
    return int(asked) if asked.isdigit() else os.cpu_count() or 1


_REPORTED = ("panoloc-mcl", "numpy", "scipy", "numba", "opencv-python-headless")


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "not installed"
