"""``panoloc demo``: what a newcomer runs first, on the embedded data set, with pictures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from panoloc_mcl.tools.cli.command import Command
from panoloc_mcl.tools.cli.notices import note
from panoloc_mcl.tools.cli.run import add_run_options, overrides_of_run, print_outcome, watched_run

if TYPE_CHECKING:
    from panoloc_mcl.tools.runs.pipeline import Outcome

# With the default settings one image is enough, and there is nothing to watch: no refinement, cautious votes, and few particles
# drawn from the image leave the work to the filter.
_SLOWED = (
    "slowed down to be watched: refinement off, votes cautious, few particles drawn from images; by default one image is enough"
)
_OBSERVATION: dict[str, Any] = {"refinement": {"enabled": False}}
#: The embedded data set that the demos drive through.
DATASET = "hall"
#: What each demo changes of the defaults.
DEMOS: dict[str, dict[str, Any]] = {
    "relocalize": {
        "sequences": ["evening_00"],
        "observation": {"votes": {**_OBSERVATION, "tolerance": 0.3}},
        "localizer": {"monte_carlo": {"particles": 5000, "recovery": {"max_share": 0.02}}},
    },
    "kidnap": {
        "sequences": ["evening_00"],
        "kidnap": {"every_frames": 10},
        "observation": {"votes": {**_OBSERVATION, "tolerance": 0.3}},
        "localizer": {
            "initial": "known_pose",
            "monte_carlo": {"particles": 5000, "recovery": {"max_share": 0.1}},
            "status": {"lost_match": 0.3},
        },
    },
}
_STORY = {
    "relocalize": "evening, the map is of noon; nothing known of the pose: the cloud collapses onto the true one",
    "kidnap": "the robot is carried away every 10 images, odometry silent: it gets lost, notices, and finds back",
}
ANIMATION = "demo.gif"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which demo, ``--open``, ``--set``, ``--seed``, ``--out``, ``--rerun``, ``--json``."""
    parser.add_argument("demo", choices=tuple(DEMOS), help="; ".join(f"{name}: {story}" for name, story in _STORY.items()))
    parser.add_argument("--open", action="store_true", help="open the report in the browser")
    add_run_options(parser)


def execute(args: argparse.Namespace) -> int:
    """Run it, print the table, write the moving picture, and print last where the results are."""
    from panoloc_mcl.tools.config import config_from_mapping

    settings = {"name": f"demo_{args.demo}", "dataset": DATASET, **DEMOS[args.demo]}
    config = config_from_mapping(settings, "demo", overrides_of_run(args))
    note(_STORY[args.demo])
    note(_SLOWED)
    outcome = watched_run(config, args)
    picture = _animate(outcome)
    if not args.json:
        print(f"report: {outcome.folder / 'report.html'}")
        if picture is not None:
            print(f"moving picture: {picture}")
    print_outcome(outcome, config, as_json=args.json)
    if args.open:
        import webbrowser

        webbrowser.open((outcome.folder / "report.html").resolve().as_uri())
    return 0


def _animate(outcome: Outcome) -> Path | None:
    """The moving picture of the demo's run; None where it cannot be drawn."""
    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.report import read_results
    from panoloc_mcl.tools.report.figures import Shot, animation, can_draw

    if not can_draw():
        note('no moving picture: matplotlib is not installed; pip install "panoloc-mcl[plot]"')
        return None
    results = read_results(outcome.folder)
    path = outcome.folder / ANIMATION
    with monitor() as watching:
        animation(Shot.of(results, results.records[0]), path, watching.progress)
    return path


COMMAND = Command("demo", "watch it find itself, or find back after being carried away", add_arguments, execute)
