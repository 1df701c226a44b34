"""``panoloc study NAME``: a question asked of the localizer on data with ground truth, answered by a table."""

from __future__ import annotations

from panoloc_mcl.laboratory.cli.reporting import family

#: One line a study: a module of `cli/studies` with its arguments in a ``COMMAND``; the work is in `laboratory/studies`.
STUDIES = (
    "filter",
    "images",
    "ablation",
    "confidence",
    "poses",
)

COMMAND = family("study", "ask how well it localizes, when, and why", "panoloc_mcl.laboratory.cli.studies", STUDIES)
