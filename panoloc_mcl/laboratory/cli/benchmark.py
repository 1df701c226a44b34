"""``panoloc benchmark NAME``: times and memory as ratios against named peers."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from panoloc_mcl.laboratory.cli.reporting import Reporting, at_least, family

if TYPE_CHECKING:
    from panoloc_mcl.laboratory.reports import Report


def _options(parser: argparse.ArgumentParser, repeats: int = 15, *, data: bool = True) -> None:
    if data:
        parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")
    parser.add_argument("--repeats", type=at_least(1), default=repeats, metavar="N", help="rounds, tasks in turns in each")


def _options_of_speed(parser: argparse.ArgumentParser) -> None:
    _options(parser)
    parser.add_argument("--along-a-drive", action="store_true", help="only along a drive, with the map that a run would use")


def _options_of_filter(parser: argparse.ArgumentParser) -> None:
    _options(parser, 30, data=False)
    counts = (10_000, 100_000, 1_000_000)
    parser.add_argument("--particles", type=at_least(1), nargs="+", default=counts, metavar="N", help="how many")


def _options_of_building(parser: argparse.ArgumentParser) -> None:
    _options(parser, 3)
    parser.add_argument("--peer", metavar="MODULE:FUNCTION", help="what else builds a map, such as oracles.building:build")


def _options_of_mapping(parser: argparse.ArgumentParser) -> None:
    _options(parser, 1)
    parser.add_argument("--drives", nargs="+", default=(), metavar="NAME", help="a map of these drives instead of references")


def _options_of_pictures(parser: argparse.ArgumentParser) -> None:
    _options(parser, 3)
    parser.add_argument("--frames", type=at_least(1), default=500, metavar="N", help="of the run whose memory is measured")


def _options_of_workers(parser: argparse.ArgumentParser) -> None:
    _options(parser, 3)
    parser.add_argument("--workers", type=at_least(1), default=2, metavar="N")
    parser.add_argument("--seeds", type=at_least(1), default=8, metavar="N", help="more make the matrix longer")


def _options_of_simulation(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config", default="configs/simulate_hall.yaml", metavar="CONFIG", help="configuration of a simulation"
    )
    parser.add_argument("--frames", type=at_least(1), default=8, metavar="N")
    parser.add_argument("--samples", type=_eights, default=32, metavar="N", help="light paths from each cell, a multiple of 8")
    parser.add_argument("--variants", nargs="+", default=("llvm_ad_rgb", "scalar_rgb"), metavar="NAME", help="of Mitsuba")


def _options_of_profile(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")


def _options_of_live(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--dataset", default="hall", metavar="DATASET", help="a data set, or the name of an embedded one")
    parser.add_argument("--seconds", type=at_least(1), default=60, metavar="S", help="how long the drive is played")
    parser.add_argument("--images", type=at_least(1), default=20, metavar="N", help="images a second")
    parser.add_argument("--megabytes", type=at_least(1), default=1000, metavar="MB", help="of the recording that is read")


def _options_of_places(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--rooms", type=at_least(1), nargs="+", default=(1, 10, 100), metavar="N", help="of a thousand places each"
    )
    parser.add_argument("--images", type=at_least(1), default=1000, metavar="N", help="by which recall is measured")
    parser.add_argument(
        "--conditions",
        type=at_least(0),
        default=0,
        metavar="N",
        help="also rank the true places of so many images in uneven light, hidden, noisy",
    )


def _eights(text: str) -> int:
    if int(text) < 8 or int(text) % 8:
        raise argparse.ArgumentTypeError(f"{text}: must be a multiple of 8")
    return int(text)


def _speed(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.speed import VARIANTS, speed

    return speed(args.dataset, args.repeats, () if args.along_a_drive else tuple(VARIANTS))


def _profile(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.profile import profile

    return profile(args.dataset, None if args.out is None else Path(args.out))


def _start(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.speed import start

    return start(args.dataset, args.repeats)


def _voting(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.voting import voting

    return voting(args.dataset, args.repeats)


def _filter(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.filter import filter_cycle

    return filter_cycle(args.particles, args.repeats)


def _building(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.maps import building

    return building(args.dataset, args.repeats, args.peer)


def _mapping(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.mapping import mapping

    return mapping(args.dataset, args.drives, args.repeats)


def _costs(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.maps import costs

    return costs(args.dataset, None if args.out is None else Path(args.out))


def _places(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.campus.places import places

    return places(args.rooms, args.images, None if args.out is None else Path(args.out), args.conditions)


def _pictures(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.pictures import pictures

    return pictures(args.dataset, args.repeats, args.frames)


def _workers(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.workers import workers

    return workers(args.dataset, args.repeats, args.workers, args.seeds)


def _simulation(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.simulation import simulation

    return simulation(args.config, args.frames, args.samples, args.variants)


def _live(args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.benchmarks.live import live

    return live(args.dataset, args.seconds, args.images, args.megabytes)


def _on_one_thread(work: Callable[[argparse.Namespace], Report], args: argparse.Namespace) -> Report:
    from panoloc_mcl.laboratory.timing import one_thread

    with one_thread():
        return work(args)


#: One line a benchmark: name, summary, options, work.
BENCHMARKS = (
    Reporting(
        "speed",
        "one image, from pixels to pose, against OpenCV's template matching",
        _options_of_speed,
        partial(_on_one_thread, _speed),
    ),
    Reporting(
        "profile",
        "where the time of an image goes, as a table and a picture",
        _options_of_profile,
        partial(_on_one_thread, _profile),
    ),
    Reporting("start", "start-up against importing NumPy; a whole run's memory", _options, _start),
    Reporting("voting", "the paper's voting against plain NumPy", _options, partial(_on_one_thread, _voting)),
    Reporting(
        "filter", "the particle filter against NumPy and two packages", _options_of_filter, partial(_on_one_thread, _filter)
    ),
    Reporting("building", "building a map", _options_of_building, partial(_on_one_thread, _building)),
    Reporting("maps", "mending a map against building it; a map of drives", _options_of_mapping, _mapping),
    Reporting("costs", "an image against the number of places and headings", _options, partial(_on_one_thread, _costs)),
    Reporting("places", "an image on maps of up to 100,000 places", _options_of_places, partial(_on_one_thread, _places)),
    Reporting("pictures", "writing the report against its run, and its memory", _options_of_pictures, _pictures),
    Reporting("workers", "a comparison on local workers against one process", _options_of_workers, _workers),
    Reporting("live", "a robot in real time: latency, memory, poses between images, a long recording", _options_of_live, _live),
    Reporting("simulation", "rendering, with LLVM and without", _options_of_simulation, _simulation),
)

COMMAND = family("benchmark", "times and memory as ratios against named peers", BENCHMARKS)
