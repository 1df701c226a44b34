"""``panoloc build-map``: build the map of a data set and write it to a file."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from panoloc_mcl.tools.cli.command import Command, add_json_option, add_set_option, overrides_of

if TYPE_CHECKING:
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """DATASET, ``-o``, ``--drives``, ``--set``, ``--json``."""
    parser.add_argument("dataset", metavar="DATASET", help="folder of a data set, or the name of an embedded one (hall)")
    parser.add_argument("-o", "--output", metavar="FILE", required=True, help="the map file, such as hall.panomap")
    parser.add_argument(
        "--as-written", action="store_true", help="build even where poses or images fit another convention far better"
    )
    parser.add_argument(
        "--drives",
        nargs="+",
        metavar="NAME",
        help="make the map from these drives (names or globs) and their odometry instead of from references",
    )
    add_set_option(parser)
    add_json_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Build and save; print what the map holds, what was moved, and last its path."""
    from panoloc_mcl.robot.errors import MapError
    from panoloc_mcl.robot.files import check_writable
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.robot.unfinished import remove_parts
    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.config import Override, config_from_mapping
    from panoloc_mcl.tools.conventions import drive_findings, reference_findings
    from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
    from panoloc_mcl.tools.runs.map_drives import drives_of

    # A build that is stopped goes on from here the next time.
    parts = Path(f"{args.output}.parts")
    named = [Override("dataset", args.dataset, args.dataset)]
    config = config_from_mapping({}, "build-map", overrides_of(args, named))
    with monitor() as watching:
        dataset = read_dataset(resolve_dataset(config.dataset), config.recording)
        check_writable(Path(args.output))
        made: tuple[Any, Any, Any, Any] = (config.observation, config.seed, watching.progress, config.map)
        if args.drives:
            drives, said = drives_of(dataset, args.drives)
            for line in said:
                watching.notice(line)
            for recorded in dataset.select(args.drives):
                for finding in drive_findings(recorded):
                    watching.notice(finding)
            built = PanoramaMap.of_drives(dataset.name, drives, *made, unfinished=parts)
        else:
            findings = reference_findings(dataset.references)
            if findings and not args.as_written:
                raise MapError([f"{finding} (or build with --as-written)" for finding in findings])
            for finding in findings:
                watching.notice(finding)
            built = PanoramaMap.build(dataset, *made, unfinished=parts)
        for note in built.notes:
            watching.notice(f"map: {note}")
        built.save(args.output)
        remove_parts(parts)
    report(built, args.output, args.json)
    return 0


def report(built: PanoramaMap, path: str, as_json: bool, **further: Any) -> None:
    """Tell of a map that was written: for people, or as one JSON object with further values."""
    from panoloc_mcl.tools.report.mending import lines_of, write_mending

    geometry, model = built.geometry, built.observation.model
    written = write_mending(built, path)
    if as_json:
        values = {
            "map": path,
            "name": built.name,
            "references": len(built.references),
            "panorama": [geometry.width, geometry.height],
            "model": model,
            "notes": list(built.notes),
            "mending": None if written is None else str(written),
        }
        print(json.dumps(values | further))
        return
    print(
        f"{built.name}: {len(built.references)} places, panoramas of {geometry.width} x {geometry.height} pixels, model {model}"
    )
    for line in lines_of(built):
        print(line)
    if written is not None:
        print(written)
    print(path)


COMMAND = Command(
    "build-map", "build the map of a data set from its references or from drives", add_arguments, execute, goes_on=True
)
