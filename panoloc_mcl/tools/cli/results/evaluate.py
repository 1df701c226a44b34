"""``panoloc evaluate``: the figures again, from the files of a results folder; or those of a foreign trajectory."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from panoloc_mcl.tools.cli.command import Command, add_json_option
from panoloc_mcl.tools.cli.notices import note

if TYPE_CHECKING:
    from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """RESULTS, ``--groundtruth``, ``--write``, ``--json``."""
    parser.add_argument(
        "results", metavar="RESULTS", help="a results folder, or 'latest' beside it; or any trajectory in TUM's form"
    )
    parser.add_argument("--groundtruth", metavar="FILE", help="the truth of a foreign trajectory, in TUM's form, too")
    parser.add_argument("--write", action="store_true", help="also write metrics.json, summary.md and report.html anew")
    add_json_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Compute and print; leave the folder alone unless asked, but print a note if it holds other figures."""
    from pathlib import Path

    from panoloc_mcl.robot.errors import ResultsError
    from panoloc_mcl.tools.report import strict_json

    path = Path(args.results)
    # `latest` is a file where links are not possible.
    foreign = path.is_file() and path.name != "latest"
    if foreign and args.groundtruth is None:
        raise ResultsError(f"{path}: is a file; name its truth with --groundtruth FILE, or name a results folder")
    if args.groundtruth is not None and (args.write or path.is_dir()):
        what = "--write" if args.write else f"{path}"
        raise ResultsError(f"{what}: a results folder has its own truth; --groundtruth goes with a single trajectory file")
    whole, metrics = _foreign(path, Path(args.groundtruth), args.json) if args.groundtruth else _own(path, args)
    print(strict_json({"folder": str(whole), "metrics": metrics}).rstrip() if args.json else whole)
    return 0


def _own(path: Path, args: argparse.Namespace) -> tuple[Path, dict[str, Any]]:
    from panoloc_mcl.tools.evaluation import evaluate
    from panoloc_mcl.tools.report import print_metrics, read_results, rewrite_figures, same_metrics
    from panoloc_mcl.tools.report.facts import as_in_the_paper

    results = read_results(path)
    metrics = evaluate(results.records, results.place_positions)
    if not args.json:
        print_metrics(metrics, beside_paper=as_in_the_paper(results.run_info))
    if args.write:
        rewrite_figures(results, metrics)
    elif not same_metrics(metrics, results.metrics):
        note(f"{results.path}: metrics.json holds other figures; write these with --write")
    return results.path, metrics


def _foreign(estimate: Path, truth: Path, silent: bool) -> tuple[Path, dict[str, Any]]:
    from panoloc_mcl.tools.report import print_metrics
    from panoloc_mcl.tools.runs.foreign import evaluate_tum, record_of_tum

    record, left_out = record_of_tum(estimate, truth)
    metrics = evaluate_tum(record)
    if not silent:
        print_metrics(metrics, beside_paper=False)
    if left_out:
        note(f"{estimate}: {left_out} of {len(record) + left_out} poses left out, for which there is no truth")
    return estimate, metrics


COMMAND = Command("evaluate", "compute the metrics of a results folder, or of any TUM trajectory", add_arguments, execute)
