"""The light at the reference places of a simulated scene, beside the paper's Table 1: a lux meter that looks up, as in the paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.laboratory.simulation.building import build
from panoloc_mcl.laboratory.simulation.drive import FreeSpace, reference_poses
from panoloc_mcl.laboratory.simulation.engine.backend import backend
from panoloc_mcl.laboratory.simulation.scene import load_scene
from panoloc_mcl.laboratory.simulation.sun import elevation_deg
from panoloc_mcl.laboratory.simulation.world import illuminance
from panoloc_mcl.robot.geometry import FloatArray

#: Minimum, maximum, mean and standard deviation, lux.
PAPER_TABLE_1 = {
    "noon": (335.0, 1288.0, 690.9, 248.8),
    "afternoon": (219.0, 857.0, 498.6, 157.9),
    "evening": (111.0, 320.0, 203.7, 63.1),
}
#: Of the meter above the floor.
METER_HEIGHT_M = 0.02
_UNKNOWN = (None,) * 4


def study(scene: str = "hall", samples: int = 4096, notice: Callable[[str], None] = lambda text: None) -> Report:
    """Measure at every reference place of a scene.

    Parameters
    ----------
    scene : str
        A shipped scene by name, or a file.
    samples : int
        Light paths to each place.
    notice : callable
        Is told how the renderer runs.
    """
    described, folder = load_scene(scene)
    places = reference_poses(FreeSpace(build(described, folder), 0.7))[:, :2]
    known = any(light in PAPER_TABLE_1 for light in described.lights)
    figures = (
        "rendered / paper, lux (difference in per cent)"
        if known
        else "rendered, lux; none of its lights is in the paper's table"
    )
    report = Report(f"{len(places)} reference places of the scene `{described.name}`: {figures}.")
    heads = ("light", "sun above the horizon, degrees", "outside, lux", "min", "max", "mean", "standard deviation")
    table = report.table("", heads)
    for light, (lux, outside) in metered(scene, places, tuple(described.lights), samples, notice).items():
        found = (lux.min(), lux.max(), lux.mean(), lux.std(ddof=1))
        cells = [_beside(a, b) for a, b in zip(found, PAPER_TABLE_1.get(light, _UNKNOWN), strict=True)]
        height = elevation_deg(described.site, described.lights[light].time_h)
        table.add(light, Number(height), Number(outside), *cells)
    return report


def _beside(found: float, paper: float | None) -> str:
    return f"{found:.1f}" if paper is None else f"{found:.1f} / {paper:g} ({100.0 * (found / paper - 1.0):+.1f})"


def metered(
    scene: str, positions: FloatArray, lights: Sequence[str], samples: int, notice: Callable[[str], None] = lambda text: None
) -> dict[str, tuple[FloatArray, float]]:
    """What a light meter on the floor says, and one outside, for each of the lights that the scene has: lux.

    Parameters
    ----------
    scene : str
    positions : float64 (n, 2)
    lights : sequence of str
    samples : int
    notice : callable

    Raises
    ------
    PanolocError
        No such scene, or the renderer is not installed.
    """
    described, folder = load_scene(scene)
    building, used = build(described, folder), backend()
    if used.remark:
        notice(used.remark)
    points = np.column_stack([positions, np.full(len(positions), METER_HEIGHT_M)])
    return {light: illuminance(building, light, points, used, samples) for light in lights if light in described.lights}
