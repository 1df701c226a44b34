import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.filters.estimate import Cluster
from panoloc_mcl.robot.filters.image_bias import ImageBias

COVARIANCE = np.diag([8e-4, 8e-4, 3e-4]) ** 2


def driven(way, sd_heading, sd_along):
    """Predicted covariance after driving straight along x with an uncertain heading: nearly singular across the way."""
    swing = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, way], [0.0, 0.0, 1.0]])
    return swing @ np.diag([sd_along, 1e-5, sd_heading]) ** 2 @ swing.T


@settings(max_examples=200, deadline=None)
@given(
    way=st.floats(0.0, 0.6),
    sd_heading=st.floats(1e-4, 0.06),
    sd_along=st.floats(1e-4, 0.02),
    turned=st.floats(-0.06, 0.06),
    across=st.floats(-0.01, 0.01),
    kept=st.floats(0.0, 0.999),
)
def test_what_is_new_of_a_measured_pose_is_no_further_from_it_than_the_bias_may_be(
    way, sd_heading, sd_along, turned, across, kept
):
    bias = ImageBias.of_first(np.array([-way, 0.0, 0.0]), COVARIANCE)
    cluster = Cluster(np.zeros(3), driven(way, sd_heading, sd_along), 1.0)
    pose = np.array([0.001, across, turned])
    seen = bias.seen(cluster, pose, COVARIANCE, kept)
    assert np.hypot(*(seen.pose - pose)[:2]) <= 5.0 * np.sqrt(2.0 * COVARIANCE[0, 0])


def test_standing_still_teaches_next_to_nothing():
    bias = ImageBias.of_first(np.zeros(3), COVARIANCE)
    cluster = Cluster(np.zeros(3), COVARIANCE, 1.0)
    assert not bias.seen(cluster, np.array([1e-5, 0.0, 0.0]), COVARIANCE, 1.0).new


def test_far_on_an_image_tells_all_it_would_alone():
    bias = ImageBias.of_first(np.zeros(3), COVARIANCE)
    cluster = Cluster(np.array([3.0, 0.0, 0.0]), np.diag([0.1, 0.1, 0.05]) ** 2, 1.0)
    seen = bias.seen(cluster, np.array([3.02, 0.01, 0.01]), COVARIANCE, 0.0)
    np.testing.assert_allclose(seen.covariance, COVARIANCE, rtol=0.05, atol=1e-10)
    np.testing.assert_allclose(seen.pose, [3.02, 0.01, 0.01], atol=2e-4)
