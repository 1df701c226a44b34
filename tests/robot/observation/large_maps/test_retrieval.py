"""A map that retrieves places before it votes gives the poses of one that votes on all of them."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles.scenes import panorama, random_world, texture, turned

from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.observation.large_maps import retrieval
from panoloc_mcl.robot.observation.large_maps.retrieval import enough
from panoloc_mcl.robot.settings.localizer import LocalizerSettings
from panoloc_mcl.robot.settings.observation import ObservationSettings, VotesSettings
from panoloc_mcl.tools.config.model import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_image

OBSERVATION = ObservationSettings(votes=VotesSettings(calibration_references=6))


@pytest.fixture(scope="module")
def small_limits() -> Iterator[None]:
    """Maps of more than twenty places are large when they are built."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("votes.MOST_DENSE", 20), ("large_maps.retrieval._FEWEST", 40), ("large_maps.retrieval._MOST", 60)):
            patch.setattr(f"panoloc_mcl.robot.observation.{name}", value)
        patch.setattr(retrieval, "SPREAD", 24)
        patch.setattr(retrieval, "_GLANCED_AT", 40)
        yield


@pytest.fixture(scope="module")
def whole(small_room: Dataset) -> PanoramaMap:
    return PanoramaMap.build(small_room, OBSERVATION)


@pytest.fixture(scope="module")
def large(small_room: Dataset, whole: PanoramaMap, small_limits: None) -> PanoramaMap:
    return PanoramaMap.build(small_room, OBSERVATION)


def played(panorama_map: PanoramaMap, dataset: Dataset, order: list[int] | None = None) -> list[Estimate]:
    """Estimates along the drive, of a robot that knows nothing; images as in ``order``, odometry silent after the drive's end."""
    drive = dataset.sequences["noon_00"]
    localizer = Localizer(panorama_map, RunConfig(localizer=LocalizerSettings(tracking=True)))
    odometry = list(zip(drive.odometry.times, drive.odometry.poses, strict=True))
    for time, pose in odometry:
        localizer.add_odometry(time, pose)
    estimates = []
    for step, index in enumerate(order or range(len(drive.files))):
        time = drive.times[step] if step < len(drive.times) else drive.times[-1] + 0.2 * (step + 1 - len(drive.times))
        if step >= len(drive.times):
            localizer.add_odometry(time, odometry[-1][1])
        estimate = localizer.add_image(time, read_image(drive.files[index]))
        assert estimate is not None
        estimates.append(estimate)
    return estimates


@pytest.mark.slow
def test_fewer_places_are_voted_on_and_the_map_keeps_how_many(
    large: PanoramaMap, whole: PanoramaMap, small_room: Dataset
) -> None:
    model = large.observation_model()
    image = large.unwrapper()(read_image(small_room.sequences["noon_00"].files[0]))
    field = model.observe(image)
    assert field.asked is not None
    assert 40 <= field.asked.likely == int(large.arrays["retrieved"][0]) <= 60
    assert len(field.asked.places) < 0.5 * len(model.places)
    assert large.arrays["coefficients"].dtype == np.float16
    assert "retrieved" not in whole.arrays
    assert whole.observation_model().observe(image).asked is None


@pytest.mark.slow
def test_along_a_drive_poses_status_and_confidence_are_those_of_all_places(
    large: PanoramaMap, whole: PanoramaMap, small_room: Dataset
) -> None:
    for one, other in zip(played(large, small_room), played(whole, small_room), strict=True):
        assert one.status is other.status
        assert np.hypot(*(one.pose - other.pose)[:2]) < 0.02
        assert one.vote_field is not None
        assert other.vote_field is not None
        assert one.vote_field.confidence == pytest.approx(other.vote_field.confidence, abs=0.05)


@pytest.mark.slow
def test_votes_are_those_of_all_places_but_for_half_precision(
    large: PanoramaMap, whole: PanoramaMap, small_room: Dataset
) -> None:
    for file in small_room.sequences["noon_00"].files[::4]:
        image = large.unwrapper()(read_image(file))
        some, every = (built.observation_model().observe(image).with_measurement(None) for built in (large, whole))
        assert some.asked is not None
        # Those of refined cells are weakened by what was seen there, in another order.
        differences = np.abs(some.votes - every.votes[:, some.asked.places])
        assert np.quantile(differences, 0.99) < 2e-3


@pytest.mark.slow
def test_the_true_place_is_among_the_retrieved(large: PanoramaMap, small_room: Dataset) -> None:
    drive, model = small_room.sequences["noon_00"], large.observation_model()
    assert drive.groundtruth is not None
    for file, pose in zip(drive.files, drive.groundtruth.poses, strict=True):
        asked = model.observe(large.unwrapper()(read_image(file))).asked
        assert asked is not None
        assert model.places.nearest(pose[None, :2])[0] in asked.places[: asked.likely]


@pytest.mark.slow
def test_somebody_carried_away_is_seen_within_three_images(large: PanoramaMap, small_room: Dataset) -> None:
    drive = small_room.sequences["noon_00"]
    assert drive.groundtruth is not None
    truth = drive.groundtruth.poses
    far = int(np.argmax(np.hypot(*(truth - truth[-1])[:, :2].T)))
    estimates = played(large, small_room, [*range(len(drive.files)), far, far, far])
    assert estimates[-4].status is Status.CONVERGED
    assert np.hypot(*(estimates[-4].pose - truth[-1])[:2]) < 0.1
    assert np.hypot(*(estimates[-1].pose - truth[far])[:2]) < 0.1


@pytest.mark.slow
def test_tracking_looks_at_as_many_places_however_large_the_map(large: PanoramaMap, small_room: Dataset) -> None:
    drive = small_room.sequences["noon_00"]
    assert drive.groundtruth is not None
    model = large.observation_model()
    assert isinstance(model, VotesModel)
    asked = retrieval.Retrieval(model._correlator, model.places).near(drive.groundtruth.poses[3, :2])
    away = np.hypot(*(model.places.positions[asked.places[: asked.likely]] - drive.groundtruth.poses[3, :2]).T)
    assert away.max() <= 8.0 * model.places.spacing
    assert len(asked.places) - asked.likely <= 40


def test_where_nothing_is_synthesised_places_are_retrieved_too(small_limits: None) -> None:
    model = VotesModel.build(random_world(30), VotesSettings(bandwidth=1.0))
    model.retrieval = retrieval.Retrieval(model._correlator, model.places, 5)
    for place in (0, 17, 29):
        field = model.observe(panorama(turned(texture(place), 7)))
        assert field.asked is not None
        assert field.asked.likely == 5
        assert field.peak.place == place


@given(st.lists(st.integers(0, 100_000), max_size=50))
def test_enough_places_are_four_times_the_worst_rank_within_limits(ranks: list[int]) -> None:
    count = enough(ranks)
    assert retrieval._FEWEST <= count <= retrieval._MOST
    if ranks and 4 * (max(ranks) + 1) < retrieval._MOST:
        assert count >= 4 * (max(ranks) + 1)
    if not ranks:
        assert count == retrieval._MOST
