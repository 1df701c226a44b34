"""The strip of a sphere that features are found on, held against COLMAP's own camera."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("pycolmap", reason="needs the extra 'peers'")

from panoloc_mcl.laboratory.peers.local_features.sphere import Sphere, cam_from_world, pose_on_plane
from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.geometry import angle_difference

GEOMETRY = PanoramaGeometry(360, 145, -50.0, 25.0)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 359.99), st.floats(8.0, 136.0), st.sampled_from([720, 1080, 1440]))
def test_a_spot_is_seen_where_colmap_looks(column: float, row: float, width: int) -> None:
    rows, columns = np.mgrid[:145, :360]
    across = (columns - column + 180.0) % 360.0 - 180.0
    spot = 200.0 * np.exp(-0.5 * (across**2 + (rows - row) ** 2) / 1.5**2)
    sphere = Sphere(GEOMETRY, width)
    strip = sphere.strip(spot.astype(np.float32)).astype(np.float64)
    moments = cv2.moments(strip[:, width // 32 : -(width // 32)])
    if not 8 < column < 352 or abs(column - 180) < 8:
        # Its centre is not that of the pixels where the seam cuts it, as the rest is a turn away. Here that is beyond 5 deviations.
        return
    found = np.array([[moments["m10"] / moments["m00"] + 0.5 + width // 32, moments["m01"] / moments["m00"] + 0.5]])
    points, inside = sphere.on_sphere(found)
    assert inside.all()
    right, down, ahead = sphere.camera().cam_ray_from_img(points)[0]
    azimuth, elevation = -np.radians(column), np.radians(25.0 - (row + 0.5) * 75.0 / 145.0)
    expected = np.array([-np.cos(elevation) * np.sin(azimuth), -np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
    assert np.degrees(np.arccos(np.clip(expected @ [right, down, ahead], -1.0, 1.0))) < 0.1


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-3.14, 3.14))
def test_poses_come_back_from_colmap(x: float, y: float, heading: float) -> None:
    pose = pose_on_plane(cam_from_world(np.array([x, y, heading])))
    assert pose[:2] == pytest.approx([x, y], abs=1e-9)
    assert abs(angle_difference(pose[2], heading)) < 1e-9


def test_what_lies_to_the_left_is_seen_in_the_left_half() -> None:
    camera = cam_from_world(np.array([1.0, 2.0, 0.5]))
    left = np.array([1.0 - np.sin(0.5), 2.0 + np.cos(0.5), 0.0])
    assert camera * left == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)


def test_features_on_the_robot_itself_do_not_count() -> None:
    valid = np.ones(GEOMETRY.shape, dtype=bool)
    valid[:, 90:180] = False
    sphere = Sphere(GEOMETRY, 720)
    # To the right of ahead, and to the left.
    points = np.array([[360.0 + 2 * 135.0, 180.0], [360.0 - 2 * 45.0, 180.0]])
    assert sphere.seen(points, valid).tolist() == [False, True]
