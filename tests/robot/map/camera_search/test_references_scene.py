"""Errors of a camera's description, found from references of a room that is cast ray by ray."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.rooms import BareRoom

from panoloc_mcl.robot.camera import LinearProfile, Mount, OmniCamera, PanoramaCamera, PanoramaGeometry, PanoramaTarget
from panoloc_mcl.robot.map.camera_search.adjustment import adjust
from panoloc_mcl.robot.map.camera_search.references_scene import ReferencesScene
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.calibration.parameters import parameters_by_references

Float64 = NDArray[np.float64]
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


CENTRE, RADII = 119.5, ((-50.0, 30.0), (25.0, 115.0))


def mirrored_room(folder: Path, centre_u: float) -> References:
    """Nine references by a mirror whose radius grows evenly with the elevation; its centre is said to be that of the image."""
    rng = np.random.default_rng(4)
    world, fine = BareRoom(finest_m=0.25), PanoramaGeometry(480, 200, -50.0, 25.0)
    v, u = np.mgrid[:240, :240].astype(np.float64)
    radius, azimuth = np.hypot(u - centre_u, v - CENTRE), np.arctan2(CENTRE - v, u - centre_u) - np.pi / 2.0
    elevation = np.radians(np.interp(radius, [one[1] for one in RADII], [one[0] for one in RADII]))
    columns, rows = fine.column_of_azimuth(azimuth).astype(np.float32), fine.row_of_elevation(elevation).astype(np.float32)
    poses = np.array([(x, y, rng.uniform(-np.pi, np.pi)) for x in (0.0, 0.7, 1.4) for y in (0.0, 0.6, 1.2)])
    files = []
    for index, pose in enumerate(poses):
        pixels = np.pad(world.panorama(fine, pose, samples=2).pixels, ((0, 0), (0, 1)), mode="wrap")
        files.append(folder / f"{index}.png")
        cv2.imwrite(
            str(files[-1]), cv2.remap(pixels, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.uint8)
        )
    described = OmniCamera(
        center_px=(CENTRE, CENTRE),
        valid_radius_px=(30.0, 115.0),
        heading_angle_deg=90.0,
        azimuth="counterclockwise",
        profile=LinearProfile(points=RADII),
        panorama=PanoramaTarget(size=(180, 72), elevation_deg=(-50.0, 25.0)),
        height_m=0.6,
    )
    return References(folder, tuple(files), poses, described, (240, 240), "base")


@pytest.mark.slow
@pytest.mark.parametrize("off", [1.0, 0.0])
def test_a_centre_that_is_off_by_a_pixel_is_named_and_a_right_one_is_not(off: float, tmp_path: Path) -> None:
    """A pixel costs centimetres, and nothing else tells it."""
    references = mirrored_room(tmp_path, CENTRE + off)
    camera = references.camera
    found = adjust(camera, parameters_by_references(camera, placed=True), ReferencesScene(references, VotesSettings(), camera))
    by_name = {one.parameter.name: one for one in found.estimates}
    for name, true in (("centre u", CENTRE + off), ("centre v", CENTRE)):
        assert by_name[name].observable
        assert by_name[name].value == pytest.approx(true, abs=0.3)
    told = {one.parameter.name for one in found.told(2.0)}
    assert ("centre u" in told) == bool(off)
    assert "centre v" not in told


def test_without_a_height_nothing_can_be_told(tmp_path: Path) -> None:
    from panoloc_mcl.robot.errors import DatasetError

    references = room(tmp_path)
    with pytest.raises(DatasetError, match=r"camera\.height_m is not given"):
        ReferencesScene(references, VotesSettings(), references.camera.model_copy(update={"height_m": None}))


def test_references_that_look_the_same_way_do_not_tell_the_place_of_the_camera(tmp_path: Path) -> None:
    references = room(tmp_path)
    headings = np.random.default_rng(0).normal(size=len(references))

    def place_sd(turned: float, sds: Float64 | None = None) -> float:
        poses = np.column_stack([references.poses[:, :2], turned * headings])
        return ReferencesScene(replace(references, poses=poses, sds=sds), VotesSettings(), references.camera).place_sd_m()

    assert place_sd(0.0) == np.inf
    assert place_sd(0.004) > 0.1
    assert place_sd(2.0) < 0.01
    told = np.column_stack([np.full(len(references), 0.05), np.full(len(references), 0.01)])
    assert place_sd(2.0, told) == pytest.approx(5.0 * place_sd(2.0))
    # And what nobody can tell is left alone, and takes nothing along.
    camera = references.camera
    by_name = {one.name: one for one in parameters_by_references(camera, placed=True, place_sd_m=0.3)}
    assert by_name["forward"].accuracy > 0.25 * by_name["forward"].largest
