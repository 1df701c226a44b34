"""``panoloc convert``: a recording in whatever layout, written as a data set folder."""

from __future__ import annotations

import argparse

from panoloc_mcl.tools.cli.command import Command, add_set_option, overrides_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """SOURCE, ``-o``, ``--camera``, ``--set``."""
    parser.add_argument("source", metavar="SOURCE", help="a bag, mcap, video, folder, COLD sequence, or a folder of such")
    parser.add_argument("-o", "--output", metavar="DATASET", required=True, help="folder to write; must not exist, or be empty")
    parser.add_argument(
        "--camera", metavar="FILE", help="camera.yaml that describes the camera, if none lies beside the recording"
    )
    add_set_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Read and write one drive after the other; print what was noticed, and last the folder."""
    from pathlib import Path

    from panoloc_mcl.tools.cli.notices import note
    from panoloc_mcl.tools.config import Override, config_from_mapping
    from panoloc_mcl.tools.datasets import copy_dataset
    from panoloc_mcl.tools.runs.pipeline import find_dataset

    named = [Override("dataset", args.source, args.source)]
    if args.camera is not None:
        named.append(Override("recording.camera", args.camera, f"--camera {args.camera}"))
    dataset = find_dataset(config_from_mapping({}, "convert", overrides_of(args, named)))
    for drive in dataset.sequences.values():
        for text in drive.notes:
            note(f"sequence {drive.name}: {text}")
    copy_dataset(dataset, Path(args.output))
    for drive in dataset.sequences.values():
        parts = [name for name, part in (("odometry", drive.odometry), ("ground truth", drive.groundtruth)) if part is not None]
        print(f"{drive.name}: {len(drive)} images, {' and '.join(parts) or 'no odometry'}")
    if len(dataset.references):
        print(f"references: {len(dataset.references)}")
    print(args.output)
    return 0


COMMAND = Command("convert", "write a recording (bag, mcap, video, COLD) as a data set folder", add_arguments, execute)
