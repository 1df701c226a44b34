"""One place of a scene under its lights, and as a raw omnidirectional camera sees it. Writes a PNG.

    python scripts/show_lights.py [--scene hall] [--lights noon afternoon evening] [--at X Y HEADING_DEG] [-o FILE]

Left: panoramas at the one fixed exposure, light after light. Right: the first of them through a mirror; and below it, what the
package unwraps of that, whose agreement with the panorama above is printed.
"""

from __future__ import annotations

import argparse
import math
import sys

import cv2
import numpy as np

from panoloc_mcl.laboratory.simulation.building import build
from panoloc_mcl.laboratory.simulation.engine.backend import backend
from panoloc_mcl.laboratory.simulation.optics import expose, ray_table
from panoloc_mcl.laboratory.simulation.renderer import RayCaster
from panoloc_mcl.laboratory.simulation.scene import load_scene
from panoloc_mcl.laboratory.simulation.settings import Rendering, Sensor
from panoloc_mcl.laboratory.simulation.world import World
from panoloc_mcl.robot.camera import PanoramaGeometry, Unwrapper
from panoloc_mcl.robot.camera.spec import OmniCamera, PanoramaCamera, PanoramaTarget, UnifiedProfile

SIZE, RAW = (360, 145), (480, 480)
PANORAMA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
MIRROR = OmniCamera(
    center_px=(239.5, 239.5),
    valid_radius_px=(28.0, 237.0),
    profile=UnifiedProfile(xi=0.9, focal_px=122.2019),
    panorama=PanoramaTarget(size=SIZE, elevation_deg=(-50.0, 25.0)),
    height_m=0.6,
)


def main(argv: list[str] | None = None) -> int:
    """Render, write the picture, print grey levels and the agreement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="hall")
    parser.add_argument("--lights", nargs="+", default=["noon", "afternoon", "evening"])
    parser.add_argument("--at", nargs=3, type=float, default=[2.0, 3.0, 0.0], metavar=("X", "Y", "HEADING_DEG"))
    parser.add_argument("--samples", type=int, default=Rendering().samples)
    parser.add_argument("-o", "--output", default="lights.png")
    arguments = parser.parse_args(argv)
    scene, folder = load_scene(arguments.scene)
    building, used, sensor = build(scene, folder), backend(), Sensor()
    if used.remark:
        print(f"note: {used.remark}", file=sys.stderr)
    caster = RayCaster(building.patches, used)
    pose = np.array([arguments.at[0], arguments.at[1], math.radians(arguments.at[2])])
    views, raw = [], None
    for number, light in enumerate(arguments.lights):
        world = World(building, light, used, arguments.samples, lambda d, n: print(f"{d}/{n}", file=sys.stderr), caster)
        seen = world.luminance(ray_table(PANORAMA, SIZE, sensor.samples), pose, 0.6)
        views.append(expose(*seen, sensor, np.random.default_rng([1, number])))
        print(f"{light}: mean grey level {views[-1].mean():.0f}, outside {world.sources.outdoor_lux:.0f} lux")
        if raw is None:
            seen = world.luminance(ray_table(MIRROR, RAW, sensor.samples), pose, 0.6)
            raw = expose(*seen, sensor, np.random.default_rng([2, number]))
    assert raw is not None
    unwrapped = Unwrapper(MIRROR, RAW, PanoramaGeometry(*SIZE, -50.0, 25.0))(raw)
    rows = slice(None) if unwrapped.valid is None else unwrapped.valid.all(axis=1)
    direct = views[0][rows].astype(np.float64).ravel()
    scores = [np.corrcoef(np.roll(unwrapped.pixels, k, axis=1)[rows].ravel(), direct)[0, 1] for k in range(-180, 180)]
    best = int(np.argmax(scores))
    print(f"raw image unwrapped against the panorama: correlation {scores[best]:.3f} at a shift of {best - 180} columns")
    line = np.full((6, SIZE[0] * 2), 255, np.uint8)
    enlarged = [cv2.resize(view, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC) for view in views]
    left = np.vstack([part for view in enlarged for part in (view, line)][:-1])
    small = cv2.resize(np.clip(unwrapped.pixels, 0, 255).astype(np.uint8), (480, 193), interpolation=cv2.INTER_AREA)
    right = np.full((left.shape[0], 480), 255, np.uint8)
    right[:480], right[490 : 490 + 193] = raw, small
    cv2.imwrite(arguments.output, np.hstack([left, np.full((left.shape[0], 6), 255, np.uint8), right]))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
