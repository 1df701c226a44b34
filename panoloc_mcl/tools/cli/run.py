"""``panoloc run``: localize over a data set and write a results folder, or repeat a run from its ``run.json``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.tools.cli.command import Command, add_json_option, add_set_option, overrides_of
from panoloc_mcl.tools.cli.notices import note

if TYPE_CHECKING:
    from panoloc_mcl.tools.config import Override, RunConfig
    from panoloc_mcl.tools.runs.pipeline import Outcome


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """CONFIG, ``--set``, ``--seed``, ``--out``, ``--rerun``, ``--json``."""
    parser.add_argument(
        "config", metavar="CONFIG", help="YAML file, such as configs/global.yaml; or RESULTS/run.json, which repeats that run"
    )
    add_run_options(parser)


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """What every command that runs takes: ``--set``, ``--seed``, ``--out``, ``--rerun``, ``--json``."""
    add_set_option(parser)
    parser.add_argument("--seed", type=int, metavar="N", help="seed of everything random")
    parser.add_argument("--out", metavar="DIR", help="folder the results folder is made in")
    add_rerun_option(parser)
    add_json_option(parser)


def overrides_of_run(args: argparse.Namespace) -> list[str | Override]:
    """The values of ``--set``, ``--seed`` and ``--out``."""
    from panoloc_mcl.tools.config import Override

    named = [(key, value) for key, value in (("seed", args.seed), ("out", args.out)) if value is not None]
    return overrides_of(args, [Override(key, value, f"--{key} {value}") for key, value in named])


def add_rerun_option(parser: argparse.ArgumentParser) -> None:
    """``--rerun [FILE.rrd]``."""
    parser.add_argument(
        "--rerun",
        nargs="?",
        const="",
        metavar="FILE.rrd",
        help="show the run in the Rerun viewer, or write it into a file for it (needs the extra rerun)",
    )


def execute(args: argparse.Namespace) -> int:
    """Run, print the figures, and last the path of the results folder."""
    from pathlib import Path

    from panoloc_mcl.tools.config import load_config
    from panoloc_mcl.tools.report import read_results
    from panoloc_mcl.tools.report.results.layout import CONFIG
    from panoloc_mcl.tools.runs.repeat import compared, is_run_info, other_versions

    path = Path(args.config)
    earlier = read_results(path.parent) if is_run_info(path) else None
    if earlier is not None and (changed := other_versions(earlier)):
        note(f"{path}: made with other versions ({changed}); last digits may differ")
    config = load_config(path if earlier is None else earlier.path / CONFIG, overrides_of_run(args))
    outcome = watched_run(config, args)
    if earlier is not None:
        note(compared(earlier, outcome.folder))
    print_outcome(outcome, config, as_json=args.json)
    return 0


def watched_run(config: RunConfig, args: argparse.Namespace) -> Outcome:
    """Run with bars, and in the viewer if that is wanted."""
    from pathlib import Path

    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.report.rerun_sink import RerunSink
    from panoloc_mcl.tools.runs.pipeline import run

    sinks = [] if args.rerun is None else [RerunSink(Path(args.rerun) if args.rerun else None)]
    with monitor() as watching:
        return run(config, args.command_line, watching, sinks)


def print_outcome(outcome: Outcome, config: RunConfig, *, as_json: bool) -> None:
    """The figures and last the path; or both as JSON."""
    from panoloc_mcl.tools.report import print_metrics, strict_json
    from panoloc_mcl.tools.report.pages.plotly_script import can_plot

    if not can_plot():
        note('report.html has no player; pip install "panoloc-mcl[report]", then: panoloc evaluate RESULTS --write')
    if as_json:
        print(strict_json({"folder": str(outcome.folder), "metrics": outcome.metrics}), end="")
        return
    tracked = config.localizer.mode == "kalman_orientation" and not config.kidnap.every_frames
    print_metrics(outcome.metrics, beside_paper=tracked)
    print(outcome.folder)


COMMAND = Command("run", "localize over a data set's sequences and write a results folder", add_arguments, execute)
