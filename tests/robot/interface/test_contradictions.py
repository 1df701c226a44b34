"""A camera that is not as it is described shows in a quarter of the images or more; people and blur do in fewer."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.interface.contradictions import Contradictions
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.observation import ObservationModel, VoteField
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.synthesis.source_errors import SourceErrors
from panoloc_mcl.tools.config.model import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_image

AGREEMENT = Agreement(0.9, np.full(24, 0.9), 0.9)


def after(excesses: list[float], way: float = 0.2) -> Contradictions:
    seen = Contradictions()
    for excess in excesses:
        seen = seen.moved(way).seen(excess)
    return seen


def test_what_a_quarter_of_the_images_shows_is_believed_of_all() -> None:
    few, many = after([0.0] * 16 + [5.0] * 4), after([0.0] * 12 + [5.0] * 8)
    assert few.usual == 0.0
    assert not few.tell
    assert many.usual == 5.0
    assert many.tell


def test_of_few_images_most_have_to_tell() -> None:
    assert Contradictions().usual == 0.0
    assert after([0.0, 7.0]).usual == 0.0
    assert after([7.0, 7.0]).usual == 7.0
    assert not after([7.0] * 7).tell
    assert after([7.0] * 8).tell


def test_a_robot_that_stands_learns_nothing_more() -> None:
    once = after([0.0])
    assert once.moved(0.05).seen(9.0).seen(9.0).excesses == (0.0,)


def test_long_ago_is_forgotten() -> None:
    assert after([9.0] * 30 + [0.0] * 30).usual == 0.0


@given(st.lists(st.floats(0.0, 100.0), max_size=60))
@settings(max_examples=50, deadline=None)
def test_kept_in_a_file_and_no_more_than_one_of_what_was_seen(excesses: list[float]) -> None:
    seen = after(excesses)
    assert Contradictions.of_array(seen.array()) == seen
    recent = np.array(excesses[-30:])
    if len(recent):
        assert seen.usual in recent
        assert np.mean(recent >= seen.usual) >= 0.25


@pytest.mark.parametrize("values", [[], [np.nan], [0.1, -1.0], [0.1] * 40, [[0.1, 0.2]]])
def test_what_cannot_be_is_refused(values: list[float]) -> None:
    with pytest.raises(ValueError, match="another form"):
        Contradictions.of_array(values)


def test_an_image_is_widened_as_if_it_contradicted_itself_as_much() -> None:
    errors = SourceErrors(np.array([1.3, 1.2]), np.zeros(2), np.zeros(2), 1.0, 20, 2.0)
    shown, of_map = np.diag([1e-6, 2e-6, 3e-6]), np.diag([4e-6, 4e-6, 1e-7])

    def of_excess(excess: float) -> PoseMeasurement:
        covariance = errors.of_image(shown, excess) + of_map
        return PoseMeasurement(
            np.zeros(3), covariance, np.zeros(2), AGREEMENT, of_map, contradiction=2.0 + excess, excess=excess
        )

    for own in (0.0, 1.5):
        np.testing.assert_allclose(of_excess(own).widened(4.0).covariance, of_excess(4.0).covariance, rtol=1e-12)
    # One that contradicts itself more keeps what it claims.
    assert (kept := of_excess(5.0)).widened(4.0) is kept


class Contradicting:
    """A model of whose images every so many-th has floor and walls that contradict each other."""

    def __init__(self, model: ObservationModel, every: int) -> None:
        self.model, self.every, self.images = model, every, 0

    def __getattr__(self, name: str):
        return getattr(self.model, name)

    def observe(self, panorama, headings=None) -> VoteField:
        votes = self.model.observe(panorama, headings)
        self.images += 1
        assert votes.measurement is not None
        own = replace(votes.measurement, excess=0.0)
        return votes.with_measurement(own if self.images % self.every else replace(own.widened(4.0), excess=4.0))


@pytest.mark.slow
def test_a_wrong_camera_makes_every_image_claim_less_and_is_said_once(
    panorama_map: PanoramaMap, small_room: Dataset, tmp_path
) -> None:
    drive = small_room.sequences["noon_00"]
    images = [read_image(file) for file in drive.files]
    # Every image's own word counts here, however doubtful in pictures as small as these.
    config = RunConfig.model_validate({"localizer": {"status": {"converged_confidence": 0.0}, "tracking": False}})
    claimed, said = {}, {}
    for every in (1000, 8, 2):
        model = Contradicting(panorama_map.observation_model(), every)
        localizer = Localizer(panorama_map, config, model=cast(ObservationModel, model))
        for time, pose in zip(drive.odometry.times, drive.odometry.poses, strict=True):
            localizer.add_odometry(time, pose)
        answers = [localizer.add_image(time, image) for time, image in zip(drive.times, images, strict=True)]
        claimed[every] = np.array([np.trace(answer.vote_field.measurement.covariance[:2, :2]) for answer in answers])
        said[every] = [answer.message for answer in answers if Reason.CAMERA_CONTRADICTED in answer.reasons]
    last = np.arange(10, len(images))
    hardly, often = last[(last + 1) % 8 > 0], last[(last + 1) % 2 > 0]
    np.testing.assert_array_equal(claimed[8][hardly], claimed[1000][hardly])
    assert (claimed[2][often] > 2.0 * claimed[1000][often]).all()
    assert said[1000] == said[8] == []
    assert len(said[2]) == 1
    assert "panoloc calibrate" in said[2][0]
    localizer.save_state(tmp_path / "state.npz")
    other = Localizer(panorama_map, config)
    other.load_state(tmp_path / "state.npz")
    assert other.contradictions == localizer.contradictions
    other.load_map(panorama_map)
    assert other.contradictions == Contradictions()
