"""The cited peers in both modes of the localizer, on a world small enough to run in a moment."""

import math

import numpy as np
import pytest
from oracles.scenes import COLUMNS, ROWS, random_world, texture, turned
from pydantic import ValidationError

from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.robot.filters import KalmanOrientationFilter, Start, Status
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import MODELS, Places, VoteField, model_named
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.robot.settings.localizer import KalmanSettings, StatusSettings
from panoloc_mcl.tools.config import RunConfig

WORLD = random_world(6)
STEP = 2.0 * np.pi / COLUMNS
PEERS = {
    "fourier_signature": {},
    "eigenspace": {"components": 5},
    "least_squares": {"components": 5},
    "spinning": {"components": 60},
    "zero_phase": {"components": 5},
    "orientation_correlation": {},
    "nearest_reference": {},
    "template_matching": {},
}
VARIANTS = [*PEERS.items(), ("fourier_signature", {"heading": "none"})]


def a_map(name: str, chosen: dict) -> PanoramaMap:
    observation = ObservationSettings.model_validate({"model": name, name: chosen})
    camera = PanoramaCamera.model_validate({"kind": "panorama", "elevation_deg": [-50.0, 25.0]})
    model = model_named(name).build(WORLD, observation.selected, 0)
    keyframes = Keyframes.surveyed(WORLD.names, np.pad(WORLD.positions, ((0, 0), (0, 1))))
    return PanoramaMap("tiny", WORLD, camera, (COLUMNS, ROWS), observation, 0, model.arrays(), keyframes)


def a_localizer(panorama_map: PanoramaMap, mode: str, initial: object) -> Localizer:
    config = RunConfig.model_validate(
        {"observation": panorama_map.observation.model_dump(), "localizer": {"mode": mode, "initial": initial}}
    )
    return Localizer(panorama_map, config)


@pytest.mark.parametrize(("name", "chosen"), VARIANTS)
def test_monte_carlo_finds_the_place(name: str, chosen: dict) -> None:
    localizer = a_localizer(a_map(name, chosen), "monte_carlo", "uniform")
    for index in range(6):
        localizer.add_odometry(float(index), (0.0, 0.0, 0.0))
        estimate = localizer.add_image(float(index), turned(texture(4), 10))
    assert np.hypot(*(estimate.pose[:2] - WORLD.positions[4])) < 0.5
    assert np.isfinite(estimate.pose).all()
    assert estimate.best_place == 4
    if localizer._observation.gives_heading:
        assert abs(angle_difference(estimate.pose[2], 10 * STEP)) < math.radians(10.0)
    else:
        # Nothing ever said which way the robot looks.
        assert estimate.clusters[0].spread_deg > 60.0 or len(estimate.clusters) > 1


@pytest.mark.parametrize(("name", "chosen"), VARIANTS)
def test_the_paper_s_tracker_reports_the_place(name: str, chosen: dict) -> None:
    start = {"x": 0.0, "y": 0.0, "heading_deg": 65.0, "sd_heading_deg": 6.0}
    localizer = a_localizer(a_map(name, chosen), "kalman_orientation", start)
    for index in range(8):
        localizer.add_odometry(float(index), (0.0, 0.0, 0.0))
        estimate = localizer.add_image(float(index), turned(texture(4), 10))
    assert estimate.best_place == 4
    assert estimate.pose[:2] == pytest.approx(WORLD.positions[4])
    if localizer._observation.gives_heading:
        assert abs(angle_difference(estimate.pose[2], 10 * STEP)) < math.radians(5.0)
    else:
        assert estimate.pose[2] == pytest.approx(math.radians(65.0))


@pytest.mark.parametrize(("name", "chosen"), VARIANTS)
def test_images_that_say_nothing_leave_the_belief_alone(name: str, chosen: dict) -> None:
    for mode in ("monte_carlo", "kalman_orientation"):
        localizer = a_localizer(a_map(name, chosen), mode, "uniform")
        first = localizer.add_image(0.0, turned(texture(4), 10))
        localizer.add_odometry(0.0, (0.0, 0.0, 0.0))
        localizer.add_odometry(1.0, (0.0, 0.0, 0.0))
        black = localizer.add_image(1.0, np.zeros((ROWS, COLUMNS), np.uint8))
        assert "black" in black.message
        assert black.best_place == first.best_place
        assert np.isfinite(black.pose).all()


@pytest.mark.parametrize(("name", "chosen"), VARIANTS)
def test_a_map_file_gives_the_same_votes(name: str, chosen: dict, tmp_path) -> None:
    built = a_map(name, chosen)
    built.save(tmp_path / "tiny.panomap")
    loaded = PanoramaMap.load(tmp_path / "tiny.panomap")
    assert loaded.observation == built.observation
    view = WORLD.panorama(2)
    assert np.array_equal(loaded.observation_model().observe(view).votes, built.observation_model().observe(view).votes)


def test_without_a_heading_the_interface_says_so() -> None:
    silent = a_map("fourier_signature", {"heading": "none"}).observation_model()
    assert not silent.gives_heading
    for headings in (None, np.array([0.1, 0.2, 0.3])):
        field = silent.observe(WORLD.panorama(2), headings)
        assert not field.gives_heading
        assert field.votes.shape == (1, len(WORLD))
        assert field.headings.tolist() == [0.0]
        assert field.full_circle
        assert field.peak.place == 2
        assert math.isnan(field.peak.heading)
        everywhere = np.column_stack([np.tile(WORLD.positions[2], (50, 1)), np.linspace(-3.0, 3.0, 50)])
        assert np.ptp(field.read(everywhere)) == 0.0
    spoken = a_map("fourier_signature", {}).observation_model()
    assert spoken.gives_heading
    assert spoken.observe(WORLD.panorama(2)).gives_heading
    # One heading asked for is one heading known.
    assert spoken.observe(WORLD.panorama(2), np.array([0.5])).gives_heading
    black = silent.observe(replace_pixels(WORLD.panorama(2), 0.0), np.array([0.1, 0.2]))
    assert not black.informative
    assert black.votes.shape == (1, len(WORLD))


def replace_pixels(panorama, value: float):
    return type(panorama)(np.full_like(panorama.pixels, value), panorama.valid)


def test_without_a_heading_proposals_look_everywhere() -> None:
    places = Places(WORLD.positions)
    votes = np.full((1, len(places)), 0.1, dtype=np.float32)
    votes[0, 3] = 0.9
    field = VoteField(votes, np.zeros(1), places, 0.1)
    poses = field.sample(20_000, np.random.default_rng(0))
    assert poses[:, 2].min() >= -np.pi
    assert poses[:, 2].max() < np.pi
    counts = np.histogram(poses[:, 2], bins=12, range=(-np.pi, np.pi))[0]
    assert counts == pytest.approx(20_000 / 12, rel=0.12)
    assert (places.nearest(poses[:, :2]) == 3).mean() > 0.6


def test_the_paper_s_tracker_takes_the_place_but_no_heading() -> None:
    places = Places(WORLD.positions)
    belief = KalmanOrientationFilter(
        places, Start(None, 0.4, sd_heading=0.1), KalmanSettings(), StatusSettings(), np.random.default_rng(0)
    )
    votes = np.full((1, len(places)), 0.1, dtype=np.float32)
    votes[0, 5] = 0.7
    belief.update(VoteField(votes, np.zeros(1), places, 0.1))
    state = belief.state()
    assert belief.heading == 0.4
    assert belief.sd_heading == 0.1
    assert state.best_place == 5
    assert state.best_place_votes == pytest.approx(0.7)
    assert math.isnan(state.match)
    assert state.status is Status.CONVERGED


@pytest.mark.parametrize("name", MODELS)
def test_every_model_is_a_choice_of_the_configuration(name: str) -> None:
    config = RunConfig.model_validate({"observation": {"model": name, name: {"tolerance": 0.31}}})
    assert config.observation.selected.tolerance == 0.31
    with pytest.raises(ValidationError):
        RunConfig.model_validate({"observation": {"model": name, name: {"tolerance": 0.0}}})


def test_there_is_no_model_without_a_choice() -> None:
    with pytest.raises(ValidationError):
        RunConfig.model_validate({"observation": {"model": "guess"}})
