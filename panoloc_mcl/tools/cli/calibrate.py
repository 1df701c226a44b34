"""``panoloc calibrate``: what a data set tells about its own camera."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from panoloc_mcl.tools.cli.command import Command, add_json_option

if TYPE_CHECKING:
    from panoloc_mcl.robot.camera import AnyCamera
    from panoloc_mcl.tools.calibration.calibrate import Findings
    from panoloc_mcl.tools.datasets import Dataset


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """DATASET, ``-o``, ``--from``, ``--drives``, ``--only-mask``, ``--json``."""
    parser.add_argument("dataset", metavar="DATASET", help="folder of a data set, or the name of an embedded one (hall)")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help="camera.yaml to write, with its mask and pictures beside it; name it in dataset.yaml with camera: {file: FILE}",
    )
    parser.add_argument(
        "--from",
        dest="calibration",
        metavar="FILE",
        help="begin with a calibration file of OCamCalib, Kalibr, OpenCV, CamOdoCal, ROS or COLMAP",
    )
    parser.add_argument("--drives", nargs="+", default=["all"], metavar="NAME", help="names or globs of drives (default all)")
    parser.add_argument("--only-mask", action="store_true", help="find the robot in the images and leave the rest as described")
    add_json_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Find, print the table, and write what was asked for; the path last."""
    from panoloc_mcl.tools.calibration.calibrate import calibrate, table_of
    from panoloc_mcl.tools.calibration.written import write_camera
    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset

    dataset = read_dataset(resolve_dataset(args.dataset))
    start = None if args.calibration is None else _with_calibration(dataset, Path(args.calibration))
    drives = dataset.select(args.drives) if dataset.sequences else []
    with monitor() as watching:
        found = calibrate(dataset, start, drives, watching.progress, only_mask=args.only_mask)
    written = [str(file) for file in write_camera(found, Path(args.output))] if args.output else []
    if args.json:
        print(json.dumps(_as_json(found, written)))
        return 0
    for line in found.lines:
        print(line)
    if found.estimates:
        _print_table(table_of(found))
    if not written:
        print("nothing written; -o camera.yaml writes the camera as found")
    for path in written:
        print(path)
    return 0


def _print_table(found: list[tuple[str, str, str, str]]) -> None:
    rows = [("", "described", "found", "standard deviation"), *found]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    for name, *cells in rows:
        right = (cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))
        print("  ".join([name.ljust(widths[0]), *right]).rstrip())


def _with_calibration(dataset: Dataset, path: Path) -> AnyCamera:
    """The camera of the data set with the optics of a calibration file; where it sits stays as described."""
    from panoloc_mcl.robot.camera import Unwrapper, camera_from_mapping, geometry_of, to_mapping
    from panoloc_mcl.robot.camera.formats import read_calibration

    subject = next(iter(dataset.sequences.values())) if dataset.sequences else dataset.references
    given = to_mapping(subject.camera)
    names = ["height_m", "mask", "mount", "time_offset_s"]
    if given["kind"] == "omni":
        names += ["looks", "heading_angle_deg", "azimuth", "valid_radius_px", "panorama"]
    kept = {key: given[key] for key in names if key in given}
    camera = camera_from_mapping({**read_calibration(path).mapping(), **kept}, str(path))
    Unwrapper(camera, subject.image_size, geometry_of(camera, subject.image_size))
    return camera


def _as_json(found: Findings, written: list[str]) -> dict[str, Any]:
    from panoloc_mcl.robot.camera import to_mapping

    camera = to_mapping(found.camera)
    camera.pop("mask", None)
    return {
        "camera": camera,
        "verdicts": found.lines,
        "parameters": {
            one.parameter.name: {
                "before": one.parameter.start,
                "after": one.value if one.observable else None,
                "sd": one.sd if one.observable else None,
            }
            for one in found.estimates
        },
        "masked": None if found.body is None else found.body.hidden,
        "files": written,
    }


COMMAND = Command("calibrate", "find a camera's mask, mounting and errors from the data set itself", add_arguments, execute)
