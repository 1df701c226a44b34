"""A tilt that stays is the mount's; one that changes is not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.interface.mounting_tilt import MountingTilt

FEW = np.radians(0.05)


def after(tilts: np.ndarray, way: float = 0.5) -> MountingTilt:
    mount = MountingTilt()
    for tilt in tilts:
        mount = mount.moved(way).seen(tilt)
    return mount


@pytest.mark.parametrize("degrees", [(2.0, 0.0), (-1.2, 1.6), (0.0, 0.0)])
def test_a_tilt_that_stays_is_learnt(degrees: tuple[float, float]) -> None:
    rng = np.random.default_rng(0)
    mount = after(np.radians(degrees) + FEW * rng.standard_normal((40, 2)))
    assert mount.known
    np.testing.assert_allclose(np.degrees([mount.pitch, mount.roll]), degrees, atol=0.05)
    assert mount.leans == (degrees != (0.0, 0.0))


@pytest.mark.parametrize("seed", range(5))
def test_a_tilt_that_changes_is_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mount = after(np.radians(2.0) * rng.standard_normal((200, 2)))
    assert not mount.known
    assert not mount.leans
    assert np.degrees(mount.sd) == pytest.approx(2.0, rel=0.2)


def test_bumps_on_a_mount_that_leans_do_not_pass_for_the_mount() -> None:
    rng = np.random.default_rng(1)
    mount = after(np.radians([2.0, 0.0]) + np.radians(1.5) * rng.standard_normal((100, 2)))
    assert not mount.known


def test_few_images_do_not_tell() -> None:
    assert not after(np.tile(np.radians([2.0, 0.0]), (5, 1))).known


def test_a_robot_that_stands_learns_nothing_more() -> None:
    once = MountingTilt().seen(np.radians([1.0, 0.0]))
    assert once.images == 1
    assert once.seen(np.radians([1.0, 0.0])).moved(0.05).seen(np.radians([1.0, 0.0])).images == 1


@given(tilts=st.lists(st.tuples(*[st.floats(-0.1, 0.1)] * 2), min_size=1, max_size=20))
@settings(max_examples=50, deadline=None)
def test_learnt_one_by_one_as_all_at_once_and_kept_in_a_file(tilts: list[tuple[float, float]]) -> None:
    mount = after(np.array(tilts))
    # The mean of the images, and of the tenth of one that stands upright.
    np.testing.assert_allclose([mount.pitch, mount.roll], np.sum(tilts, axis=0) / (len(tilts) + 0.1), atol=1e-12)
    assert MountingTilt.of_array(mount.array()) == mount
    assert MountingTilt.of_array(mount.array()).moved(1.0).seen(np.zeros(2)) == mount.moved(1.0).seen(np.zeros(2))


@pytest.mark.parametrize("values", [np.zeros(5), np.zeros(3), np.array([1.0, np.nan, 0.0, 1.0, 0.0]), -np.ones(5)])
def test_what_is_no_tilt_is_refused(values: np.ndarray) -> None:
    with pytest.raises(ValueError, match="tilt of the mount"):
        MountingTilt.of_array(values)
