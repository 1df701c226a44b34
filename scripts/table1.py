"""The light at the reference locations of the hall beside the paper's Table 1, as lines of Markdown.

    python scripts/table1.py [--scene hall] [--samples N] [--height M]

A lux meter that looks up is held at each reference location, as in the paper; deviations in percent of the paper's figures.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from panoloc_mcl.laboratory.simulation.backend import backend
from panoloc_mcl.laboratory.simulation.building import build
from panoloc_mcl.laboratory.simulation.drive import FreeSpace, reference_poses
from panoloc_mcl.laboratory.simulation.scene import load_scene
from panoloc_mcl.laboratory.simulation.sun import elevation_deg
from panoloc_mcl.laboratory.simulation.world import illuminance

#: Minimum, maximum, mean and standard deviation, lux.
PAPER = {
    "noon": (335.0, 1288.0, 690.9, 248.8),
    "afternoon": (219.0, 857.0, 498.6, 157.9),
    "evening": (111.0, 320.0, 203.7, 63.1),
}


def main(argv: list[str] | None = None) -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="hall")
    parser.add_argument("--samples", type=int, default=4096, help="light paths to each location")
    parser.add_argument("--height", type=float, default=0.02, help="of the meter above the floor, m")
    arguments = parser.parse_args(argv)
    scene, folder = load_scene(arguments.scene)
    used = backend()
    if used.remark:
        print(f"note: {used.remark}", file=sys.stderr)
    building = build(scene, folder)
    places = reference_poses(FreeSpace(building, 0.7))
    points = np.column_stack([places[:, :2], np.full(len(places), arguments.height)])
    print(f"{len(places)} locations; rendered / paper, lux (difference in percent)")
    print()
    print("| light | sun above the horizon | outside | min | max | mean | std. dev. |")
    print("|---|---|---|---|---|---|---|")
    for light, paper in PAPER.items():
        lux, outside = illuminance(building, light, points, used, arguments.samples)
        found = (lux.min(), lux.max(), lux.mean(), lux.std(ddof=1))
        cells = [f"{a:.1f} / {b:g} ({100.0 * (a / b - 1.0):+.1f})" for a, b in zip(found, paper, strict=True)]
        height = elevation_deg(scene.site, scene.lights[light].time_h)
        print(f"| {light} | {height:.0f}° | {outside:.0f} | {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
