"""``panoloc inspect``: what is in a map, a data set or a results folder, in words and in a picture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from panoloc_mcl.tools.cli.command import Command, add_json_option

if TYPE_CHECKING:
    from panoloc_mcl.tools.report.inspection import Inspection


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """WHAT, ``-o``, ``--json``."""
    parser.add_argument(
        "what", metavar="MAP|DATASET|RESULTS", help="a map file, a data set's folder or embedded name, or a results folder"
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="also draw it into a file that ends in .pdf, .png or .svg")
    add_json_option(parser)


def execute(args: argparse.Namespace) -> int:
    """Tell, and draw if a file is named."""
    import json

    from panoloc_mcl.tools.cli.monitor import monitor
    from panoloc_mcl.tools.report import strict_json
    from panoloc_mcl.tools.report.figures import need_matplotlib, style, write_figure

    if args.output is not None:
        need_matplotlib()
    with monitor() as watching:
        found, draw = _look(args.what, watching)
    if args.output is not None:
        with style("inspection"):
            write_figure(draw(), Path(args.output))
    if args.json:
        print(json.dumps(json.loads(strict_json(found.values))))
        return 0
    width = max(len(label) for label, _ in found.lines)
    for label, text in found.lines:
        print(f"{label:{width}}  {text}")
    if args.output is not None:
        print(args.output)
    return 0


def _look(what: str, watching: Any) -> tuple[Inspection, Any]:
    """What was found, and how to draw it."""
    from panoloc_mcl.robot.errors import ResultsError
    from panoloc_mcl.tools.datasets import EMBEDDED
    from panoloc_mcl.tools.report.results import layout

    path = Path(what)
    if (path / "dataset.yaml").is_file() or (what in EMBEDDED and not path.exists()):
        return _dataset(what, watching)
    if path.is_file() and path.name != layout.LATEST:
        return _map(path, watching)
    if path.is_dir() or path.name == layout.LATEST:
        return _results(path)
    raise ResultsError(
        f"{what}: neither a map file, a data set nor a results folder; check the path, or use {', '.join(EMBEDDED)}"
    )


def _map(path: Path, watching: Any) -> tuple[Inspection, Any]:
    from panoloc_mcl.robot.map.panorama_map import PanoramaMap
    from panoloc_mcl.tools.report.figures.inspection import draw_map_inspection
    from panoloc_mcl.tools.report.inspection import confusion_of, eigenimages_of, inspect_map

    panorama_map = PanoramaMap.load(path)
    model = panorama_map.observation_model()
    references = panorama_map.references
    eigen = eigenimages_of(references)
    confusion = confusion_of(references, model, watching.progress)
    found = inspect_map(panorama_map, model, confusion, eigen)
    return found, lambda: draw_map_inspection(references, model.places, eigen, confusion, None, panorama_map.keyframes)


def _dataset(name: str, watching: Any) -> tuple[Inspection, Any]:
    from panoloc_mcl.robot.observation import Places
    from panoloc_mcl.robot.references import read_references
    from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
    from panoloc_mcl.tools.report.figures.inspection import draw_map_inspection
    from panoloc_mcl.tools.report.inspection import eigenimages_of, inspect_dataset

    dataset = read_dataset(resolve_dataset(name))
    references = read_references(dataset.references, watching.progress)
    eigen = eigenimages_of(references)
    found = inspect_dataset(dataset, references, eigen)
    return found, lambda: draw_map_inspection(references, Places(references.positions), eigen, None, dataset)


def _results(path: Path) -> tuple[Inspection, Any]:
    from panoloc_mcl.tools.report import read_results
    from panoloc_mcl.tools.report.figures import draw_overview
    from panoloc_mcl.tools.report.inspection import inspect_results

    results = read_results(path)
    return inspect_results(results), lambda: draw_overview(results.records, results.place_positions)


COMMAND = Command("inspect", "tell what is in a map, a data set or a results folder", add_arguments, execute)
