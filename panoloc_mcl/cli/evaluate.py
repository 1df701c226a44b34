"""``panoloc evaluate``: the figures again, from the files of a results folder."""

from __future__ import annotations

import argparse

from panoloc_mcl.cli.command import Command, add_json_option
from panoloc_mcl.cli.notices import note


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """RESULTS, ``--write``, ``--json``."""
    parser.add_argument("results", metavar="RESULTS", help="a results folder, or 'latest' beside it")
    parser.add_argument("--write", action="store_true", help="also write metrics.json, summary.md and report.html anew")
    add_json_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Compute and print; leave the folder alone unless asked, but say so if it holds other figures."""
    from pathlib import Path

    from panoloc_mcl.evaluation import evaluate
    from panoloc_mcl.report import print_metrics, read_results, rewrite_figures, same_metrics, strict_json

    results = read_results(Path(args.results))
    metrics = evaluate(results.records, results.place_positions)
    if not args.json:
        print_metrics(metrics, beside_paper=results.run_info.get("mode") == "kalman_orientation")
    if args.write:
        rewrite_figures(results, metrics)
    elif not same_metrics(metrics, results.metrics):
        note(f"{results.path}: metrics.json holds other figures; write these with --write")
    print(strict_json({"folder": str(results.path), "metrics": metrics}).rstrip() if args.json else results.path)
    return 0


COMMAND = Command("evaluate", "compute the metrics of a results folder again", add_arguments, execute)
