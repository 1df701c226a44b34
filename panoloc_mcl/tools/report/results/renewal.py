"""Figures of an older results folder, computed again: are they the same, and if not, in with the new ones."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from panoloc_mcl.robot.errors import OutputError, ResultsError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.tools.report.results import layout
from panoloc_mcl.tools.report.pages.html import render_report
from panoloc_mcl.tools.report.results.results_folder import strict_json
from panoloc_mcl.tools.report.results.results_reader import Results
from panoloc_mcl.tools.report.summary import render_summary


def same_metrics(metrics: Mapping[str, Any], written: Mapping[str, Any]) -> bool:
    """Whether ``metrics.json`` would come out the same, number by number."""
    return bool(json.loads(strict_json(metrics)) == written)


def rewrite_figures(results: Results, metrics: Mapping[str, Any]) -> None:
    """Write ``summary.md``, ``report.html`` and, last, ``metrics.json`` anew.

    Raises
    ------
    ResultsError
        A file cannot be written; each one is whole, old or new.
    """
    texts = {
        layout.SUMMARY: render_summary(metrics, results.run_info),
        layout.REPORT: render_report(
            metrics, results.run_info, results.records, results.place_positions, results.path, results.place_files
        ),
        layout.METRICS: strict_json(metrics),
    }
    for name, text in texts.items():
        try:
            write_atomically(results.path / name, text)
        except OutputError as error:
            raise ResultsError(error.faults) from error
