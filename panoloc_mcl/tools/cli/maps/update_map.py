"""``panoloc update-map``: bring a map up to date with later drives."""

from __future__ import annotations

import argparse
from pathlib import Path

from panoloc_mcl.tools.cli.command import Command, add_json_option, add_set_option, overrides_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """MAP, DATASET, ``--drives``, ``-o``, ``--set``, ``--json``."""
    parser.add_argument("map", metavar="MAP", help="a map file; it is replaced whole, or stays as it is")
    parser.add_argument("dataset", metavar="DATASET", help="folder of the data set with the drives")
    parser.add_argument("--drives", nargs="+", metavar="NAME", required=True, help="names or globs of drives with odometry")
    parser.add_argument("-o", "--output", metavar="FILE", help="write the new map here and leave MAP alone")
    add_set_option(parser)
    add_json_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Update and save; print what was done, and last the path."""
    from panoloc_mcl.robot.files import check_writable
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.robot.map.updating import update_map
    from panoloc_mcl.robot.unfinished import remove_parts
    from panoloc_mcl.tools.cli.maps.build_map import report
    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.config import Override, config_from_mapping
    from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
    from panoloc_mcl.tools.runs.map_drives import drives_of

    config = config_from_mapping({}, "update-map", overrides_of(args, [Override("dataset", args.dataset, args.dataset)]))
    path = args.output or args.map
    with monitor() as watching:
        old = PanoramaMap.load(args.map)
        check_writable(Path(path))
        dataset = read_dataset(resolve_dataset(config.dataset), config.recording, old.camera)
        drives, said = drives_of(dataset, args.drives)
        for line in said:
            watching.notice(line)
        # An update that is stopped goes on from here the next time.
        parts = Path(f"{path}.parts")
        done = update_map(old, drives, config.map, watching.progress, parts)
        for line in done.notes:
            watching.notice(line)
        if done.changed or args.output is not None:
            done.panorama_map.save(path)
        remove_parts(parts)
    report(done.panorama_map, path, args.json, changed=done.changed, done=list(done.notes))
    return 0


COMMAND = Command("update-map", "bring a map up to date with later drives", add_arguments, execute, goes_on=True)
