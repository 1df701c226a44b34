"""Names in a results folder, shared by those who write and those who read one."""

from __future__ import annotations

RESULTS_FORMAT = "panoloc-results"
RESULTS_VERSION = 1
METRICS_FORMAT = "panoloc-metrics"
METRICS_VERSION = 1

CONFIG = "config.yaml"
RUN_INFO = "run.json"
PLACES = "places.csv"
SUMMARY = "summary.md"
REPORT = "report.html"
#: Written last: a folder without it is one of a run that did not finish.
METRICS = "metrics.json"

TRAJECTORY = "trajectory.tum"
GROUND_TRUTH = "groundtruth.tum"
STEPS = "steps.csv"
FRAMES = "frames.npz"

LATEST = "latest"
TIME_FORMAT = "%Y%m%d_%H%M%S"
PLACES_HEADER = ("index", "file", "x", "y")


def run_folder(sequence: str, run: int) -> str:
    """Path of a run's folder within the results folder: ``noon_00/run_0``."""
    return f"{sequence}/run_{run}"
