"""``panoloc build-map``: build the map of a data set and write it to a file."""

from __future__ import annotations

import argparse
import json

from panoloc_mcl.tools.cli.command import Command, add_json_option, add_set_option, overrides_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """DATASET, ``-o``, ``--set``, ``--json``."""
    parser.add_argument("dataset", metavar="DATASET", help="folder of a data set, or the name of an embedded one (hall)")
    parser.add_argument("-o", "--output", metavar="FILE", required=True, help="the map file, such as hall.panomap")
    parser.add_argument(
        "--as-written", action="store_true", help="build even where poses or images fit another convention far better"
    )
    add_set_option(parser)
    add_json_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Build and save; print what the map holds, and last its path."""
    from panoloc_mcl.robot.errors import MapError
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.config import Override, config_from_mapping
    from panoloc_mcl.tools.conventions import reference_findings
    from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset

    named = [Override("dataset", args.dataset, args.dataset)]
    config = config_from_mapping({}, "build-map", overrides_of(args, named))
    with monitor() as watching:
        folder = resolve_dataset(config.dataset)
        dataset = read_dataset(folder)
        findings = reference_findings(dataset.references)
        if findings and not args.as_written:
            raise MapError([f"{finding} (or build with --as-written)" for finding in findings])
        for finding in findings:
            watching.notice(finding)
        built = PanoramaMap.build(dataset, config.observation, config.seed, watching.progress)
        for note in built.notes:
            watching.notice(f"map: {note}")
        built.save(args.output)
    geometry = built.geometry
    if args.json:
        print(
            json.dumps(
                {
                    "map": args.output,
                    "name": built.name,
                    "references": len(built.references),
                    "panorama": [geometry.width, geometry.height],
                    "model": config.observation.model,
                    "notes": list(built.notes),
                }
            )
        )
        return 0
    print(
        f"{built.name}: {len(built.references.names)} places, panoramas of {geometry.width} x {geometry.height} pixels, "
        f"model {config.observation.model}"
    )
    print(args.output)
    return 0


COMMAND = Command("build-map", "build the map of a data set from its references", add_arguments, execute)
