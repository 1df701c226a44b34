"""Cameras that are off by more than calibrations usually are, as the references have it."""

from __future__ import annotations

from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.robot.map.camera_search.adjustment import adjust
from panoloc_mcl.robot.map.camera_search.references_scene import ReferencesScene
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.calibration.parameters import parameters_by_references, shown
from panoloc_mcl.tools.datasets import Dataset

# A look, not a calibration: few references, few steps.
_TARGETS, _STEPS = 6, (3.0, 3.0, 3.0, 1.5, 1.5)
# What is worth a word: degrees, metres, pixels; of the focal length a share.
_CLAIMED = {"elevation shift": 1.5, "pitch": 1.5, "roll": 1.5, "yaw": 3.0, "height": 0.06, "forward": 0.04, "left": 0.04}
_CLAIMED |= {"centre u": 3.0, "centre v": 3.0, "focal scale": 0.03}
_CERTAIN = 4.0


def doubts(dataset: Dataset) -> list[str]:
    """One line if the references fit each other better with another camera; empty if not, or where they cannot tell.

    Parameters
    ----------
    dataset : Dataset
    """
    references = dataset.references
    try:
        scene = ReferencesScene(references, VotesSettings(), references.camera, _TARGETS)
        parameters = parameters_by_references(
            references.camera, placed=references.poses_of == "base", place_sd_m=scene.place_sd_m()
        )
        found = adjust(references.camera, parameters, scene, schedule=_STEPS)
    except PanolocError:
        return []
    off = []
    for one in found.estimates:
        change, unit = one.value - one.parameter.start, one.parameter.unit
        if one.observable and abs(change) > max(_CLAIMED[one.parameter.name], _CERTAIN * one.sd):
            off.append(f"{one.parameter.name} {shown(change, unit)} {unit}".rstrip())
    if not off:
        return []
    return [
        f"{dataset.path}: camera: looks off by {', '.join(off)}, as the references have it; see panoloc calibrate {dataset.path}"
    ]
