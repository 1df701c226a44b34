import numpy as np

from panoloc_mcl.robot.motion.pace import paced
from panoloc_mcl.robot.reasons import Reason


def told(times, positions, spread_m=0.05, limit_m_s=0.5):
    before, findings = None, []
    for time, position in zip(times, positions, strict=True):
        before, finding = paced(before, time, position, spread_m, limit_m_s)
        findings.append(finding)
    return findings


def test_a_fast_robot_is_told_of_and_a_slow_one_is_not():
    times = np.arange(8.0)
    fast = told(times, np.column_stack([1.5 * times, np.zeros(8)]))
    assert [bool(finding) for finding in fast] == [False] * 3 + [True] * 5
    assert fast[3].reason is Reason.FASTER_THAN_BELIEVED
    assert "4 images in a row say that the robot drives at up to 1.5 m/s" in fast[3]
    assert "image_only_speed_m_s (0.5)" in fast[3]
    assert not any(told(times, np.column_stack([0.45 * times, np.zeros(8)])))


def test_a_kidnap_and_a_wrong_image_are_not_speed():
    times = np.arange(8.0)
    kidnapped = np.where(times[:, None] < 4, [[0.0, 0.0]], [[5.0, 5.0]])
    assert not any(told(times, kidnapped))
    wrong = np.zeros((8, 2))
    wrong[4] = 9.0
    assert not any(told(times, wrong))


def test_noise_of_frequent_images_is_not_speed():
    rng = np.random.default_rng(0)
    assert not any(told(np.arange(200) / 30.0, rng.normal(0.0, 0.05, (200, 2))))
