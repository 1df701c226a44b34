"""``panoloc export``: the keyframes of a map as a data set, and as a trajectory."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoloc_mcl.tools.cli.command import Command


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """MAP, ``-o``, ``--tum``."""
    parser.add_argument("map", metavar="MAP", help="a map file")
    parser.add_argument("-o", "--output", metavar="DATASET", required=True, help="folder that the data set is written into")
    parser.add_argument("--tum", metavar="FILE", help="also write the poses of the keyframes as a TUM trajectory")


def execute(args: argparse.Namespace) -> int:
    """Write, and print where."""
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.tools.cli.notices import note
    from panoloc_mcl.tools.datasets import keyframe_trajectory, write_map_as_dataset, write_tum

    panorama_map = PanoramaMap.load(args.map)
    write_map_as_dataset(panorama_map, Path(args.output))
    if args.tum is not None:
        trajectory, remark = keyframe_trajectory(panorama_map)
        if remark:
            note(remark)
        write_tum(Path(args.tum), trajectory)
        print(args.tum)
    print(args.output)
    return 0


COMMAND = Command("export", "write the keyframes of a map as a data set", add_arguments, execute)
