"""What held-out references teach, on a scripted model and on a map of a bare room."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles.rooms import BareRoom
from oracles.scenes import grid
from scipy.optimize import minimize

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.observation import calibration
from panoloc_mcl.robot.observation.calibration import Calibration, calibrate, most_likely_tolerance
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.observation.regression import expected_calibration_error, fitted, log_loss, probabilities
from panoloc_mcl.robot.observation.votes import VotesModel
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VirtualPlacesSettings, VotesSettings

PLACES = Places(np.array([[x, y] for x in np.arange(0.0, 4.0, 0.25) for y in np.arange(0.0, 1.1, 0.25)]))


def references(count: int = 8) -> ReferencePanoramas:
    rng = np.random.default_rng(0)
    pixels = rng.integers(30, 200, (count, 24, 40), dtype=np.uint8)
    positions = np.array([[0.5 * index, 0.5] for index in range(count)])
    names = tuple(f"{index}.png" for index in range(count))
    return ReferencePanoramas(pixels, None, positions, names, PanoramaGeometry(40, 24, -50.0, 25.0), 0.6)


@dataclass
class Oracle:
    """Knows upright images of its reference, and finds them at the true heading; others it puts anywhere, with few votes.

    Of an image that shows the place in some of its rows only, its other half agrees no better than by chance.
    """

    known: ReferencePanoramas
    index: int
    shortfall: float = 0.0

    def observe(self, panorama) -> VoteField:
        rng = np.random.default_rng(int(panorama.pixels.sum()))
        columns = panorama.pixels.shape[1]
        votes = rng.uniform(0.0, 0.05, (columns, len(PLACES))).astype(np.float32)
        own = self.known.pixels[self.index].astype(np.float32)
        by_row = [np.mean(np.abs(np.roll(own, -shift, axis=1) - panorama.pixels), axis=1) for shift in range(columns)]
        shifts = np.mean(by_row, axis=1)
        # Corrupted or not, the right shift differs least; upside down, none does.
        clear = np.median(shifts) - np.min(shifts) > 5.0
        heading = -2.0 * np.pi * int(np.argmin(shifts)) / columns
        pose = np.array([*self.known.positions[self.index], heading]) if clear else np.array([3.9, 0.9, 0.0])
        place = int(PLACES.nearest(pose[None, :2])[0])
        row = round(heading * columns / (2.0 * np.pi)) % columns
        votes[row, place] = 0.8 if clear else 0.06
        if clear and self.shortfall:
            # A place beside it has more.
            votes[row, place + 1] = votes[row, place] / (1.0 - self.shortfall)
        agreement = rng.normal(0.8 if clear else 0.05, 0.05, (2, 24))
        # Where rows fit another shift clearly better, this half of them is of somewhere else.
        elsewhere = np.min(by_row, axis=0) < by_row[int(np.argmin(shifts))] - 5.0
        agreement[[half.mean() > 0.5 for half in np.array_split(elsewhere, 2)]] = 0.05
        by_half = agreement.mean(axis=1)
        found = Agreement(float(by_half.mean()), agreement.ravel(), float(by_half.min()))
        measurement = PoseMeasurement(pose, np.eye(3) * 1e-4, np.zeros(2), found)
        return VoteField(votes, 2.0 * np.pi * np.arange(columns) / columns, PLACES, 0.1, measurement=measurement)


@pytest.fixture(scope="module")
def learnt() -> Calibration:
    known = references()
    found = calibrate(lambda index: Oracle(known, index), known, 8)
    assert found is not None
    return found


def test_right_and_wrong_poses_are_told_apart(learnt: Calibration) -> None:
    known = references()
    true = Oracle(known, 3).observe(Panorama(known.pixels[3].astype(np.float32)))
    foreign = Oracle(known, 3).observe(Panorama(np.random.default_rng(9).uniform(30, 200, (24, 40)).astype(np.float32)))
    assert learnt.confidence(true) > 0.9
    assert learnt.confidence(foreign) < 0.2
    assert learnt.images == 8 * (len(calibration.CONDITIONS) + len(calibration.NOWHERE) + len(calibration.HALVED))
    assert learnt.ece < 0.15
    assert learnt.log_loss < 0.25


@pytest.mark.parametrize("shortfall", [0.0, 0.2])
def test_the_tolerance_is_what_the_true_pose_falls_short(shortfall: float) -> None:
    known = references()
    found = calibrate(lambda index: Oracle(known, index, shortfall), known, 8)
    assert found is not None
    assert found.tolerance == pytest.approx(shortfall, abs=0.03)


def test_threads_change_nothing(learnt: Calibration) -> None:
    known = references()
    again = calibrate(lambda index: Oracle(known, index), known, 8, threads=3)
    assert again is not None
    assert np.array_equal(again.array(), learnt.array())


def test_a_map_file_keeps_all_of_it(learnt: Calibration) -> None:
    restored = Calibration.of_array(learnt.array())
    assert np.array_equal(restored.array(), learnt.array())
    assert restored.images == learnt.images


@pytest.mark.parametrize("most", [0, 1])
def test_without_held_out_references_nothing_is_learnt(most: int) -> None:
    known = references()
    assert calibrate(lambda index: Oracle(known, index), known, most) is None


def test_a_single_reference_teaches_nothing() -> None:
    known = references(1)
    assert calibrate(lambda index: Oracle(known, index), known, 8) is None


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), min_size=1, max_size=60))
def test_calibration_error_agrees_with_its_definition(pairs: list[tuple[float, bool]]) -> None:
    probabilities, right = np.array([p for p, _ in pairs]), np.array([r for _, r in pairs])
    expected = 0.0
    for low in range(10):
        inside = [(p, r) for p, r in pairs if min(int(p * 10), 9) == low]
        if inside:
            gap = abs(float(np.mean([p for p, _ in inside]) - np.mean([r for _, r in inside])))
            expected += gap * len(inside) / len(pairs)
    assert expected_calibration_error(probabilities, right) == pytest.approx(expected, abs=1e-12)


def test_log_loss_of_certain_and_of_blind_predictions() -> None:
    right = np.array([True, False])
    assert log_loss(np.array([1.0, 0.0]), right) == pytest.approx(0.0, abs=1e-9)
    assert log_loss(np.array([0.5, 0.5]), right) == pytest.approx(np.log(2.0))
    assert np.isfinite(log_loss(np.array([0.0, 1.0]), right))


@pytest.mark.parametrize("never_against", [False, True])
def test_the_regression_minimises_its_loss(never_against: bool) -> None:
    rng = np.random.default_rng(4)
    seen = rng.normal(0.0, [1.0, 5.0, 0.1], (80, 3))
    right = seen @ [1.0, 0.2, -4.0] + rng.normal(0.0, 1.0, 80) > -0.5
    found = fitted(seen, right, never_against=never_against)
    spread = seen.std(axis=0)

    def loss(weights: np.ndarray) -> float:
        scores = np.where(right, 1.0, -1.0) * (weights[0] + seen @ weights[1:])
        scaled = weights[1:] * spread
        centre = weights[0] + seen.mean(axis=0) @ weights[1:]
        return float(np.log1p(np.exp(-scores)).mean() + 0.003 * scaled @ scaled + 1e-3 * centre**2)

    bounds = [(-1e3, 1e3), *[(0.0 if never_against else -1e3, 1e3)] * 3]
    options: Any = {"maxiter": 20000, "xatol": 1e-8, "fatol": 1e-12}
    expected = minimize(loss, np.zeros(4), method="Nelder-Mead", bounds=bounds, options=options).x
    assert loss(found) <= loss(expected) + 1e-6


@given(st.integers(0, 2**32 - 1), st.integers(6, 60), st.floats(0.0, 5.0))
def test_more_evidence_never_makes_an_image_less_sure(seed: int, count: int, more: float) -> None:
    rng = np.random.default_rng(seed)
    seen, right = rng.normal(size=(count, 3)), rng.random(count) > 0.5
    # One figure that happens to be smaller where the pose is right.
    seen[:, 2] -= 2.0 * right
    weights = fitted(seen, right, 1.0 / 3.0, never_against=True)[None]
    before = probabilities(seen, weights)
    for figure in range(3):
        assert (probabilities(seen + more * np.eye(3)[figure], weights) >= before - 1e-12).all()


@pytest.mark.parametrize("copies", [1, 5])
def test_how_many_trials_are_wrong_does_not_matter_but_how_often_images_are(copies: int) -> None:
    rng = np.random.default_rng(7)
    right, wrong = rng.normal(1.0, 1.0, (400, 1)), rng.normal(-1.0, 1.0, (400, 1))
    seen, is_right = np.vstack([right, *[wrong] * copies]), np.repeat([True, False], [400, 400 * copies])
    for wrong_share in (0.1, 0.5):
        weights = fitted(seen, is_right, wrong_share)
        # Of two equal normal distributions two standard deviations apart, Bayes' rule gives the logit 2 x + log prior odds.
        assert weights[1] == pytest.approx(2.0, abs=0.45)
        assert weights[0] == pytest.approx(np.log((1.0 - wrong_share) / wrong_share), abs=0.4)


def test_a_wrong_heading_is_wrong() -> None:
    """An oracle that always looks the other way teaches that nothing can be trusted, so nothing is learnt."""
    known = references()

    class Backwards(Oracle):
        def observe(self, panorama):
            field = super().observe(panorama)
            pose = field.measurement.pose + np.array([0.0, 0.0, np.pi])
            turned = PoseMeasurement(pose, field.measurement.covariance, np.zeros(2), field.measurement.agreement)
            votes = np.roll(field.votes, len(field.headings) // 2, axis=0)
            return VoteField(votes, field.headings, PLACES, 0.1, measurement=turned)

    assert calibrate(lambda index: Backwards(known, index), known, 8) is None


def test_sectors_vote_as_a_whole_image_of_them() -> None:
    columns = np.ones(48)
    agreement = Agreement.of_columns(0.5 * columns, columns, columns)
    assert agreement.cosine == pytest.approx(0.5)
    assert agreement.sectors == pytest.approx(np.full(24, 0.5))
    assert agreement.unanimity > 100.0


def test_hidden_sectors_do_not_vote() -> None:
    seen = np.r_[np.ones(24), np.zeros(24)]
    agreement = Agreement.of_columns(0.5 * seen, seen, np.ones(48))
    assert np.isnan(agreement.sectors[12:]).all()
    assert np.isfinite(agreement.sectors[:12]).all()
    nothing = Agreement.of_columns(np.zeros(48), np.zeros(48), np.zeros(48))
    assert nothing.cosine == 0.0
    assert nothing.unanimity == 0.0


def test_a_half_that_does_not_agree_is_told() -> None:
    """The floor of a place, and the walls of another."""
    ones = np.ones((2, 48))
    agreement = Agreement.of_columns(np.array([[0.1], [0.7]]) * ones, ones, ones)
    assert agreement.cosine == pytest.approx(0.4)
    assert agreement.weakest == pytest.approx(0.1)
    assert agreement.unanimity < 10.0
    # A half of which nothing is seen has no say.
    hidden = Agreement.of_columns(np.array([[0.0], [0.7]]) * ones, ones, np.array([[0.0], [1.0]]) * ones)
    assert hidden.weakest == pytest.approx(0.7)
    assert np.isnan(hidden.sectors[:24]).all()


def test_the_upper_part_is_turned_against_the_lower_one() -> None:
    image = np.random.default_rng(3).integers(0, 255, (24, 40), dtype=np.uint8)
    turned = calibration._halved(image, np.random.default_rng(0))
    same = (turned == image).all(axis=1)
    assert 8 <= (~same).sum() <= 16
    assert same[16:].all()
    assert not same[:8].any()
    assert np.array_equal(np.sort(turned, axis=1), np.sort(image, axis=1))


def test_chance_is_less_unanimous_than_a_match() -> None:
    rng = np.random.default_rng(1)
    chance = Agreement.of_columns(rng.normal(0.0, 0.3, 240), np.ones(240), np.ones(240))
    match = Agreement.of_columns(rng.normal(0.5, 0.3, 240), np.ones(240), np.ones(240))
    assert match.unanimity > 4.0 * abs(chance.unanimity)


def test_the_tolerance_is_that_of_the_true_poses() -> None:
    """Shortfalls drawn from a Gaussian, over a map whose votes are spread evenly: the width that they were drawn with is found."""
    rng = np.random.default_rng(0)
    of_map = np.tile(1.0 - (1.0 - np.square((np.arange(256) + 0.5) / 256)), (2000, 1))
    for width in (0.03, 0.1):
        found = most_likely_tolerance(np.abs(rng.normal(0.0, width, 2000)), of_map)
        assert found == pytest.approx(width, rel=0.2)
    # True poses that lie no better than any others tell nothing.
    assert most_likely_tolerance(rng.uniform(0.0, 1.0, 2000), of_map) is None


def test_a_map_without_views_learns_from_the_references_and_refuses_nothing() -> None:
    room = BareRoom(low=(-1.5, -1.2), high=(2.6, 2.7)).references(PanoramaGeometry(90, 36, -50.0, 25.0), grid(7, 5, 0.25))
    settings = VotesSettings(thinning=False, virtual_places=VirtualPlacesSettings(enabled=False))
    model = VotesModel.build(room, settings)
    assert model.calibration is not None
    restored = VotesModel.restore(room, settings, model.arrays())
    image = room.panorama(9)
    assert restored.observe(image).tolerance == model.observe(image).tolerance
    assert model.observe(image).confidence > 0.9
    # Taken nowhere: doubted, but not refused, since what was learnt from is harder than what a robot sees.
    nowhere = model.observe(Panorama(np.ascontiguousarray(image.pixels[::-1])))
    assert nowhere.confidence < 0.5
    assert nowhere.informative
