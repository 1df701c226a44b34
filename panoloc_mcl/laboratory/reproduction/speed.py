"""Speed: one image from pixels to pose with each method, beside the paper's 0.8 Hz."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.benchmarks.voting import plain_votes
from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.laboratory.reproduction.bench import Bench
from panoloc_mcl.laboratory.timing import interleaved
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.tools.config import Override, config_from_mapping
from panoloc_mcl.tools.streams import answers, recorded

PAPER_HZ = 0.8


def speed(bench: Bench, methods: Mapping[str, Mapping[str, Any]], rounds: int, light: str) -> list[str]:
    """One image from pixels to pose with each method, and the paper's voting in plain NumPy, in turns in one run."""
    first = bench.frames[light][0]
    drive, start = first.drive, (float(first.truth[0]), float(first.truth[1]), float(first.truth[2]))
    messages = list(recorded(drive.of(range(min(rounds + 1, len(drive))))))
    tasks: dict[str, Callable[[], object]] = {}
    for method, settings in methods.items():
        config = config_from_mapping({}, method, [Override(key, value, key) for key, value in settings.items()])
        panorama_map = bench.maps.get(config.observation.model)
        if panorama_map is not None:
            localizer = Localizer(panorama_map, config, camera=drive.camera, image_size=drive.image_size, start_pose=start)
            tasks[method] = partial(next, answers(localizer, messages), None)
    if "paper" in bench.maps:
        tasks["the paper's voting in plain NumPy: from filter responses to votes for 5 headings"] = plain_votes(
            bench.maps["paper"], bench.panorama(first), PaperSettings()
        )
    spent = interleaved(tasks, min(rounds, len(drive) - 1))
    lines = [
        "## Speed",
        "",
        f"One image from pixels to pose, in turns, one thread of BLAS each; the paper had {PAPER_HZ} Hz.",
        "",
    ]
    lines += [
        "| | median ms | Hz | times the paper's |",
        "|---|---|---|---|",
        f"| paper | {1000 / PAPER_HZ:.0f} | {PAPER_HZ} | 1 |",
    ]
    for name, times in spent.items():
        median = float(np.median(times.clock))
        lines.append(f"| {name} | {1000 * median:.1f} | {1 / median:.1f} | {1 / median / PAPER_HZ:.0f} |")
    return [*lines, ""]
