"""``summary.md``: a run on one page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from panoloc_mcl.tools.report.facts import DEFINITIONS, facts, tables_of, title_of
from panoloc_mcl.tools.report.pages.rendering import template


def render_summary(metrics: Mapping[str, Any], run_info: Mapping[str, Any]) -> str:
    """Text of ``summary.md``.

    Parameters
    ----------
    metrics : mapping
        From ``evaluate``.
    run_info : mapping
        As for ``run.json``; of it name, started, dataset, sequences, mode, initial, model, seed, runs,
        kidnap_every_frames, command, versions, machine and threads are shown where they are given.
    """
    return template("summary.md.j2").render(
        title=title_of(run_info), facts=facts(run_info), tables=tables_of(metrics, run_info), definitions=DEFINITIONS
    )
