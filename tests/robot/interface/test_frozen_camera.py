"""A camera that delivers one image again and again while the robot drives on."""

import numpy as np
import pytest

from panoloc_mcl.robot.errors import FrozenCameraError
from panoloc_mcl.robot.interface.frozen_camera import FrozenCamera

IMAGE = np.arange(12, dtype=np.uint8).reshape(3, 4)
HERE, NEAR, AHEAD, TURNED = (np.array(pose) for pose in ([1.0, 2.0, 3.1], [1.02, 2.0, 3.1], [1.1, 2.0, 3.1], [1.0, 2.0, -3.1]))


@pytest.mark.parametrize("moved", [AHEAD, TURNED])
def test_the_same_image_after_a_way_is_not_of_now(moved: np.ndarray) -> None:
    camera = FrozenCamera()
    camera.check(IMAGE, HERE)
    camera.check(IMAGE, NEAR)
    with pytest.raises(FrozenCameraError, match="the camera is frozen"):
        camera.check(IMAGE.copy(), moved)
    # It goes on once another image comes.
    camera.check(IMAGE + 1, moved)


@pytest.mark.parametrize("driven", [None, HERE])
def test_who_stands_or_tells_no_motion_may_see_the_same_again(driven: np.ndarray | None) -> None:
    camera = FrozenCamera()
    for _ in range(3):
        camera.check(IMAGE, driven)


def test_black_images_are_not_called_frozen() -> None:
    camera = FrozenCamera()
    for way in range(3):
        camera.check(np.zeros((3, 4), np.uint8), np.array([way, 0.0, 0.0]))
