"""``panoloc plot``: one figure of a results folder, for a paper."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from panoloc_mcl.tools.cli.command import Command

if TYPE_CHECKING:
    from panoloc_mcl.tools.evaluation import SequenceRecord
    from panoloc_mcl.tools.report import Results

#: What can be drawn, and what it shows.
FIGURES = {
    "overview": "all runs: estimates coloured by error, and how errors are distributed",
    "trajectory": "estimate and truth on the map",
    "errors": "position and heading error over time",
    "heading": "heading over time",
    "status": "what the localizer thought of itself over time",
    "particles": "particles and their effective number over time",
    "stages": "time of one image by stage",
    "frame": "one recorded frame: panorama, best reference, votes, particles",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """RESULTS, ``--figure``, ``-o``, ``--sequence``, ``--run``, ``--frame``."""
    parser.add_argument("results", metavar="RESULTS", help="a results folder, or 'latest' beside it")
    parser.add_argument(
        "--figure", choices=tuple(FIGURES), required=True, help="; ".join(f"{name}: {what}" for name, what in FIGURES.items())
    )
    parser.add_argument("-o", "--output", metavar="FILE", required=True, help="a file that ends in .pdf, .png or .svg")
    parser.add_argument("--sequence", metavar="NAME", help="which sequence; the first if left out")
    parser.add_argument("--run", type=int, default=0, metavar="N", help="which run over it (default 0)")
    parser.add_argument("--frame", type=int, default=0, metavar="N", help="row of steps.csv for --figure frame (default 0)")


def execute(args: argparse.Namespace) -> int:
    """Draw it and print the path."""
    from pathlib import Path

    from panoloc_mcl.tools.report import read_results
    from panoloc_mcl.tools.report.results import layout
    from panoloc_mcl.tools.report.figures import (
        Shot,
        draw_errors,
        draw_frame,
        draw_overview,
        draw_series,
        draw_trajectory,
        need_matplotlib,
        style,
        write_figure,
    )
    from panoloc_mcl.tools.report.results.steps import read_figures

    need_matplotlib()
    results = read_results(Path(args.results))
    record = _chosen(results, args.sequence, args.run)
    with style(args.figure):
        if args.figure == "overview":
            figure = draw_overview(results.records, results.place_positions)
        elif args.figure == "trajectory":
            figure = draw_trajectory(record, results.place_positions)
        elif args.figure == "errors":
            figure = draw_errors(record)
        elif args.figure == "frame":
            shot = Shot.of(results, record)
            figure = draw_frame(shot, shot.recording.frame_of(args.frame))
        else:
            steps = read_figures(results.path / layout.run_folder(record.name, record.run) / layout.STEPS)
            figure = draw_series(args.figure, record, steps)
        write_figure(figure, Path(args.output))
    print(args.output)
    return 0


def _chosen(results: Results, sequence: str | None, run: int) -> SequenceRecord:
    from panoloc_mcl.robot.errors import ResultsError

    names = list(dict.fromkeys(record.name for record in results.records))
    wanted = names[0] if sequence is None else sequence
    if wanted not in names:
        raise ResultsError(f"{results.path}: --sequence {wanted}: no such sequence; there are {', '.join(names)}")
    of_name = {record.run: record for record in results.records if record.name == wanted}
    if run not in of_name:
        raise ResultsError(f"{results.path}: --run {run}: no such run of {wanted}; there are 0 to {max(of_name)}")
    return of_name[run]


COMMAND = Command("plot", "draw one figure of a results folder into a file", add_arguments, execute)
