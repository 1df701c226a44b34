import numpy as np
import pytest

from panoloc_mcl.robot.filters.estimate import Cluster
from panoloc_mcl.robot.filters.image_bias import ImageBias, kept_share
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement

COVARIANCE = np.diag([8e-4, 8e-4, 3e-4]) ** 2


def test_a_measured_pose_is_corrected_by_no_more_than_its_bias_may_be():
    # After 30 cm along one direction with an uncertain last turn, as odometry of the rendered hall gives it: the predicted covariance
    # is nearly singular across the way, and what the image says there alone would be centimetres off.
    xy, x_heading, y_heading = 3.037e-5, 1.859e-6, 3.993e-6
    predicted = np.array([[1.1712e-5, xy, x_heading], [xy, 8.2988e-5, y_heading], [x_heading, y_heading, 2.3822e-3]])
    bias = ImageBias.of_first(np.array([-0.00887, 5.00439, -1.92192]), COVARIANCE)
    cluster = Cluster(np.array([-0.008644, 5.001537, -1.419903]), predicted, 1.0)
    measured = np.array([-0.009870, 5.004471, -1.399249])
    seen = bias.seen(cluster, measured, COVARIANCE, np.full(3, 0.976))
    assert np.hypot(*(seen.pose - measured)[:2]) <= 5.0 * np.sqrt(2.0 * COVARIANCE[0, 0])


def test_standing_still_teaches_next_to_nothing():
    bias = ImageBias.of_first(np.zeros(3), COVARIANCE)
    cluster = Cluster(np.zeros(3), COVARIANCE, 1.0)
    assert not bias.seen(cluster, np.array([1e-5, 0.0, 0.0]), COVARIANCE, np.ones(3)).new


def test_far_on_an_image_tells_all_it_would_alone():
    bias = ImageBias.of_first(np.zeros(3), COVARIANCE)
    cluster = Cluster(np.array([3.0, 0.0, 0.0]), np.diag([0.1, 0.1, 0.05]) ** 2, 1.0)
    seen = bias.seen(cluster, np.array([3.02, 0.01, 0.01]), COVARIANCE, np.zeros(3))
    np.testing.assert_allclose(seen.covariance, COVARIANCE, rtol=0.05, atol=1e-10)
    np.testing.assert_allclose(seen.pose, [3.02, 0.01, 0.01], atol=3e-4)  # a hundredth stays with the prediction


@pytest.mark.parametrize("way", [0.0, 0.1, 1.0, 100.0])
def test_what_a_map_errs_by_as_a_whole_is_shared_by_all_images(way: float) -> None:
    frame = np.diag([9e-5, 9e-5, 0.0])
    view = COVARIANCE
    kept = kept_share(
        PoseMeasurement(np.zeros(3), frame + view, np.zeros(2), Agreement(0.9, np.ones(24)), of_frame=frame), way, 1.0
    )
    assert np.all(kept[:2] >= 9e-5 / (9e-5 + view[0, 0]))
    assert np.all(kept <= 1.0)
    alone = kept_share(PoseMeasurement(np.zeros(3), view, np.zeros(2), Agreement(0.9, np.ones(24))), way, 1.0)
    assert np.all(alone <= kept)
    # Headings err alike for longer than positions.
    assert alone[2] >= alone[0]
    assert way > 0.0 or np.all(alone == 1.0)
