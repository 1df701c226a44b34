"""``panoloc check``: everything that is wrong with a configuration and its data set, without running."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.tools.cli.command import Command, add_set_option, overrides_of

if TYPE_CHECKING:
    from panoloc_mcl.tools.config import Override, RunConfig


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """CONFIG, ``--set``."""
    parser.add_argument("config", metavar="CONFIG", help="YAML file, such as configs/global.yaml")
    add_set_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Print every fault, one a line, or that there are none."""
    overrides = overrides_of(args)
    faults = find_faults(args.config, overrides)
    for fault in faults:
        print(fault, file=sys.stderr)
    if not faults:
        for doubt in find_doubts(args.config, overrides):
            print(doubt)
        print("no faults")
    return 2 if faults else 0


def find_faults(path: str, overrides: list[str | Override]) -> list[str]:
    """Faults of a configuration, of its data set, and of the two together.

    Raises
    ------
    ConfigError
        A file that cannot be read at all.
    """
    from panoloc_mcl.robot.settings.validation import read_yaml
    from panoloc_mcl.tools.config import dataset_in, load_config

    if "scene" in read_yaml(Path(path)):
        # By name: the laboratory stands above the tools.
        laboratory = importlib.import_module("panoloc_mcl.laboratory.cli.simulate")
        return list(laboratory.simulation_faults(Path(path), overrides))
    if "input" in read_yaml(Path(path)):
        return _live_faults(path, overrides)
    config: RunConfig | None = None
    faults: list[str] = []
    try:
        config = load_config(path, overrides)
    except PanolocError as error:
        faults += error.faults
    dataset = dataset_in(path, overrides)
    if dataset is None:
        return faults
    of_dataset = _dataset_faults(dataset)
    if config is not None and not of_dataset:
        faults += _faults_together(config)
    if not faults and not of_dataset:
        of_dataset = _wrong_conventions(dataset, config)
    return faults + of_dataset


def find_doubts(path: str, overrides: list[str | Override]) -> list[str]:
    """What runs, but looks off: a camera that its own references fit badly."""
    from panoloc_mcl.tools.calibration.claims import doubts
    from panoloc_mcl.tools.config import dataset_in
    from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset

    name = dataset_in(path, overrides)
    if name is None:
        return []
    folder = resolve_dataset(name)
    return doubts(read_dataset(folder)) if (folder / "dataset.yaml").exists() else []


def _live_faults(path: str, overrides: list[str | Override]) -> list[str]:
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.tools.config.live import load_live_config

    try:
        for file in load_live_config(path, overrides).every_map:
            PanoramaMap.load(file)
    except PanolocError as error:
        return list(error.faults)
    return []


def _dataset_faults(name: str) -> list[str]:
    from panoloc_mcl.tools.datasets import check_dataset, resolve_dataset
    from panoloc_mcl.tools.datasets.recordings import is_recording, recordings_in

    try:
        path = resolve_dataset(name)
        # Recordings are read with the configuration.
        return (
            check_dataset(path)
            if (path / "dataset.yaml").exists() or (not recordings_in(path) and not is_recording(path))
            else []
        )
    except PanolocError as error:
        return list(error.faults)


def _wrong_conventions(name: str, config: RunConfig | None) -> list[str]:
    """Angles, axes, columns and clocks that run another way than what is written, as the images have it."""
    from panoloc_mcl.tools.conventions import convention_findings
    from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset

    motion = None if config is None else config.localizer.motion
    return convention_findings(read_dataset(resolve_dataset(name)), motion=motion)


def _faults_together(config: RunConfig) -> list[str]:
    """What would stop a run before its first frame: sequences that are not there, a map or a start that does not fit."""
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.tools.runs.pipeline import check_task, find_dataset, make_tasks

    faults: dict[str, None] = {}
    panorama_map = None
    try:
        panorama_map = PanoramaMap.load(config.map.file) if config.map.file is not None else None
    except PanolocError as error:
        faults.update(dict.fromkeys(error.faults))
    try:
        dataset = find_dataset(config)
        tasks = make_tasks(dataset, config)
    except PanolocError as error:
        return [*faults, *error.faults]
    if config.map.file is None and not len(dataset.references):
        faults[
            f"{dataset.path}: holds no references; set map to a map file, or references to {{from: SEQUENCE, every_m: 0.5}}"
        ] = None
    for task in tasks:
        try:
            check_task(task, panorama_map, config)
        except PanolocError as error:
            faults.update(dict.fromkeys(error.faults))
    return list(faults)


COMMAND = Command("check", "validate a configuration and its data set without running", add_arguments, execute)
