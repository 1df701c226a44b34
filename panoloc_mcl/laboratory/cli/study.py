"""``panoloc study NAME``: a question asked of the localizer on data with ground truth, answered by a table."""

from __future__ import annotations

import importlib

from panoloc_mcl.laboratory.cli.reporting import Reporting, family

#: One line a study: a module of `cli/studies` with its arguments in a ``COMMAND``; the work is in `laboratory/studies`.
STUDIES = (
    "filter",
    "images",
    "ablation",
    "confidence",
    "maps.poses",
    "soak",
    "kills",
    "fuzz",
    "doubt",
    "floors",
    "consistency",
    "light",
    "cameras.camera",
    "cameras.mount",
    "cameras.yaw",
    "streams.layouts",
    "streams.racing",
    "maps.map",
    "maps.frame",
    "maps.colmap",
)

_MEMBERS: list[Reporting] = [importlib.import_module(f"panoloc_mcl.laboratory.cli.studies.{name}").COMMAND for name in STUDIES]

COMMAND = family("study", "ask how well it localizes, when, and why", _MEMBERS)
