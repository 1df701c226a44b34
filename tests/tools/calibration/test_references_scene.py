"""Errors of a camera's description, found from references of a room that is cast ray by ray."""

from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
from oracles.rooms import BareRoom

from panoloc_mcl.robot.camera import Mount, PanoramaCamera, PanoramaGeometry
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.calibration.adjustment import adjust
from panoloc_mcl.tools.calibration.parameters import parameters_by_references
from panoloc_mcl.tools.calibration.references_scene import ReferencesScene

GEOMETRY = PanoramaGeometry(180, 72, -50.0, 25.0)
TRUE = Mount(x_m=0.1, y_m=-0.05, yaw_deg=12.0)


def room(folder: Path, poses_of: Literal["base", "camera"] = "base") -> References:
    """Twelve references at random headings, taken by a camera that is not on the turning centre and looks aside."""
    rng = np.random.default_rng(2)
    world = BareRoom(finest_m=0.25)
    base = np.array([(x, y, rng.uniform(-np.pi, np.pi)) for x in (0.0, 0.7, 1.4, 2.1) for y in (0.0, 0.6, 1.2)])
    files = []
    for index, pose in enumerate(base):
        camera = TRUE.camera_poses(pose) + np.array([0.0, 0.0, TRUE.yaw])
        pixels = world.panorama(GEOMETRY, camera).pixels.astype(np.uint8)
        files.append(folder / f"{index}.png")
        cv2.imwrite(str(files[-1]), pixels)
    described = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
    return References(folder, tuple(files), base, described, (180, 72), poses_of)


@pytest.mark.slow
def test_the_mount_and_the_elevations_are_found(tmp_path: Path) -> None:
    references = room(tmp_path)
    wrong = references.camera.model_copy(update={"elevation_deg": (-48.5, 26.5), "height_m": 0.62})
    found = adjust(wrong, parameters_by_references(wrong, placed=True), ReferencesScene(references, VotesSettings(), wrong))
    by_name = {one.parameter.name: one for one in found.estimates}
    assert by_name["yaw"].value == pytest.approx(12.0, abs=0.3)
    assert by_name["forward"].value == pytest.approx(0.1, abs=0.008)
    assert by_name["left"].value == pytest.approx(-0.05, abs=0.008)
    assert abs(by_name["pitch"].value) < 0.1
    assert abs(by_name["roll"].value) < 0.1
    assert found.camera.elevation_deg == pytest.approx((-50.0, 25.0), abs=0.5)
    assert found.camera.height_m == pytest.approx(0.6, abs=0.02)
    assert found.after > found.before


def test_without_a_height_nothing_can_be_told(tmp_path: Path) -> None:
    from panoloc_mcl.robot.errors import DatasetError

    references = room(tmp_path)
    with pytest.raises(DatasetError, match=r"camera\.height_m is not given"):
        ReferencesScene(references, VotesSettings(), references.camera.model_copy(update={"height_m": None}))
