"""Bayes' rule with its two chances: the robot was carried elsewhere, the image is wrong about itself."""

import numpy as np
import pytest
from oracles.fields import STANDING, hills, moved
from oracles.scenes import grid

from panoloc_mcl.robot.compact_poses import CompactPoses
from panoloc_mcl.robot.filters import MonteCarloFilter, Start, Status
from panoloc_mcl.robot.filters.particles.likelihood import Likelihood
from panoloc_mcl.robot.filters.particles.prior import Prior, gaussian, uniform_density
from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.motion import carried
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.settings.localizer import MonteCarloSettings, RecoverySettings, ResamplingSettings, StatusSettings

PLACES = Places(grid(6, 5))
HERE, THERE = np.array([1.37, 1.62, 0.5]), np.array([4.0, 3.0, -2.5])
STEP = moved(0.0, 0.0, 0.0)
COVARIANCE = np.diag([0.004, 0.004, np.radians(0.1)]) ** 2


def a_filter(start: Start | None = None, seed: int = 0, **settings) -> MonteCarloFilter:
    settings.setdefault("particles", 2000)
    return MonteCarloFilter(
        PLACES, start or Start(), MonteCarloSettings(**settings), StatusSettings(), np.random.default_rng(seed)
    )


def image_of(pose: np.ndarray, doubt: float = 0.004, covariance: np.ndarray = COVARIANCE):
    field = hills(PLACES, pose).with_measurement(
        PoseMeasurement(pose, covariance, np.zeros(2), Agreement(0.9, np.full(24, 0.9), 0.9))
    )
    return field.judged(1.0 - doubt, "")


def mass_at(belief: MonteCarloFilter, pose: np.ndarray) -> float:
    near = np.hypot(*(belief.poses[:, :2] - pose[:2]).T) < 0.3
    return float(belief.weights[near].sum())


def settled(seed: int = 0, **settings) -> MonteCarloFilter:
    belief = a_filter(seed=seed, **settings)
    for _ in range(3):
        belief.propagate(STEP)
        belief.update(image_of(HERE))
        assert belief.state().status is Status.CONVERGED
    belief.propagate(STEP)
    return belief


@pytest.mark.parametrize("seed", range(4))
def test_a_doubtful_image_that_contradicts_leaves_the_belief_where_it_is(seed: int) -> None:
    belief = settled(seed)
    belief.update(image_of(THERE, doubt=0.5))
    state = belief.state()
    assert mass_at(belief, HERE) > 0.9
    assert state.status is Status.CONVERGED
    assert state.elsewhere < 0.05


@pytest.mark.parametrize("seed", range(4))
def test_a_sure_image_that_contradicts_divides_the_belief_and_the_next_decides(seed: int) -> None:
    for truth in (HERE, THERE):
        belief = settled(seed)
        belief.update(image_of(THERE, doubt=0.01))
        state = belief.state()
        # One chance in a hundred that it was carried off against one in a hundred that the image is wrong.
        assert 0.2 < mass_at(belief, HERE) < 0.8
        assert 0.2 < mass_at(belief, THERE) < 0.8
        assert state.elsewhere == pytest.approx(0.5, abs=0.25)
        assert state.status is Status.LOST
        belief.propagate(STEP)
        belief.update(image_of(truth))
        state = belief.state()
        assert mass_at(belief, truth) > 0.95
        assert state.status is Status.CONVERGED
        assert np.hypot(*(state.clusters[0].pose - truth)[:2]) < 0.01


@pytest.mark.parametrize("seed", range(4))
def test_who_was_sure_of_a_pose_says_lost_before_being_sure_of_another(seed: int) -> None:
    belief = settled(seed)
    # Too doubtful to shake the belief, but remembered by a few particles, so that the next image is no surprise.
    belief.update(image_of(THERE, doubt=0.3))
    assert belief.state().status is Status.CONVERGED
    belief.propagate(STEP)
    belief.update(image_of(THERE))
    state = belief.state()
    assert mass_at(belief, THERE) > 0.9
    assert state.elsewhere < StatusSettings().lost_chance
    assert state.status is Status.LOST
    # Whoever asks twice gets the same answer.
    assert belief.state().status is Status.LOST
    belief.propagate(STEP)
    belief.update(image_of(THERE))
    assert belief.state().status is Status.CONVERGED


def test_between_images_a_long_way_refutes_nothing_and_ends_nothing() -> None:
    sure, refuted = settled(), settled()
    sure.update(image_of(HERE))
    refuted.update(image_of(THERE, doubt=0.3))
    refuted.propagate(STEP)
    refuted.update(image_of(THERE))
    for belief, status in ((sure, Status.CONVERGED), (refuted, Status.LOST)):
        assert belief.state().status is status
        # Exact odometry: as sure of where it is as before.
        belief.propagate(moved(0.8, 0.0, 1.5, sd_position=0.0, sd_heading=0.0))
        assert belief.state().status is status


def test_an_image_that_fits_nowhere_does_not_end_being_lost() -> None:
    belief = settled()
    belief.update(image_of(THERE, doubt=0.01))
    belief.update(image_of(HERE).judged(0.0, "image fits nowhere"))
    assert belief.state().status is Status.LOST


def test_where_recovery_is_off_nobody_is_carried_off() -> None:
    belief = settled(recovery=RecoverySettings(min_share=0.0, max_share=0.0))
    belief.update(image_of(THERE))
    assert mass_at(belief, HERE) > 0.95
    assert belief.state().elsewhere == 0.0


@pytest.mark.parametrize(
    ("sd_m", "sd_deg"), [(0.05, 2.0), (0.008, 0.2), (0.004, 0.1), (0.002, 0.05)], ids=["wide", "twice", "equal", "sharp"]
)
def test_prediction_and_measured_pose_are_fused_as_normal_distributions_are(sd_m: float, sd_deg: float) -> None:
    """Whichever of them is the sharper: weights make up for who was drawn from what."""
    before = HERE + np.array([0.6, -0.4, 0.0]) * sd_m + np.array([0.0, 0.0, 0.3]) * np.radians(sd_deg)
    expected_information = np.diag(np.array([sd_m, sd_m, np.radians(sd_deg)]) ** -2.0)
    information = np.linalg.inv(COVARIANCE)
    fused = np.linalg.inv(expected_information + information)
    mean = fused @ (expected_information @ before + information @ HERE)
    means, covariances = [], []
    for seed in range(20):
        start = Start((before[0], before[1]), before[2], sd_m, np.radians(sd_deg))
        belief = a_filter(start, seed, resampling=ResamplingSettings(below=0.0))
        belief.update(image_of(HERE))
        w, off = belief.weights, belief.poses - HERE
        near = np.hypot(off[:, 0], off[:, 1]) < 0.5
        w = np.where(near, w, 0.0) / w[near].sum()
        means.append(w @ off)
        covariances.append(((off - w @ off) * w[:, None]).T @ (off - w @ off))
    sds = np.sqrt(np.diag(fused))
    # The density's wider part and the votes of the doubtful share leave a little outside.
    assert np.all(np.abs(np.mean(means, axis=0) - (mean - HERE)) < 0.35 * sds)
    assert np.sqrt(np.median([np.diag(c) for c in covariances], axis=0)) == pytest.approx(sds, rel=0.35)


@pytest.mark.parametrize("seed", range(3))
def test_standing_still_teaches_nothing_new(seed: int) -> None:
    """The same view errs by the same: only what is fresh about an image averages out."""
    rng, belief = np.random.default_rng(seed), a_filter(seed=seed)
    sds = np.sqrt(np.diag(COVARIANCE))
    bias = sds * rng.standard_normal(3)
    spreads, off = [], []
    for _ in range(200):
        belief.propagate(STANDING)
        belief.update(image_of(HERE + bias + 0.1 * sds * rng.standard_normal(3)))
        state = belief.state()
        assert state.status is Status.CONVERGED
        spreads.append(state.clusters[0].spread_m)
        off.append(np.hypot(*(state.clusters[0].pose - HERE - bias)[:2]))
    assert spreads[-1] > 0.85 * sds[0]
    assert max(spreads[1:]) < 1.3 * sds[0]
    assert max(off[1:]) < 0.6 * sds[0]


def test_a_drive_teaches_for_as_far_as_it_leads() -> None:
    """Errors that vary along the way: the belief is as far off as it says; if images were taken to err each by itself, it is not."""
    squares: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        beliefs = {correlated: a_filter(seed=seed, correlated=correlated) for correlated in squares}
        sds, truth = np.sqrt(np.diag(COVARIANCE)), HERE.copy()
        bias = sds * rng.standard_normal(3)
        for _ in range(25):
            # References stand a metre apart, so errors of the view are alike for two decimetres.
            kept = np.exp(-0.01 / 0.2)
            bias = kept * bias + np.sqrt(1.0 - kept**2) * sds * rng.standard_normal(3)
            truth = compose(truth, np.array([0.01, 0.0, 0.0]))
            for belief in beliefs.values():
                belief.propagate(moved(0.01, 0.0, 0.0, 0.0005, 0.0002))
                belief.update(image_of(truth + bias))
        for correlated, belief in beliefs.items():
            best = belief.state().clusters[0]
            off = (best.pose - truth)[:2]
            squares[correlated].append(off @ np.linalg.solve(best.covariance[:2, :2], off) / 2.0)
    assert 0.3 < np.mean(squares[True]) < 2.0
    assert np.mean(squares[False]) > 3.0


def test_standing_still_images_that_err_each_by_itself_sharpen_and_never_lose_the_pose() -> None:
    """Measured poses err by more than they say, and prediction has no noise at all."""
    rng, belief = np.random.default_rng(5), a_filter(correlated=False)
    for _ in range(40):
        belief.propagate(STANDING)
        belief.update(image_of(HERE + 2.0 * np.sqrt(np.diag(COVARIANCE)) * rng.standard_normal(3)))
        state = belief.state()
        assert state.status is Status.CONVERGED
    assert np.hypot(*(state.clusters[0].pose - HERE)[:2]) < 0.008
    assert state.clusters[0].spread_m < 0.01


def test_the_way_back_to_a_late_image_is_as_uncertain_as_the_way() -> None:
    back = moved(-0.5, 0.0, 0.0, 0.04, 0.01)
    belief = a_filter()
    for _ in range(3):
        belief.update(image_of(compose(HERE, back.increment)), back)
    cluster = belief.state().clusters[0]
    assert np.hypot(*(cluster.pose - HERE)[:2]) < 0.04
    assert 0.01 < cluster.spread_m < 0.08


def test_a_covariance_is_carried_as_particles_are() -> None:
    way = moved(0.5, 0.1, 0.4, 0.03, 0.05)
    start = Start((HERE[0], HERE[1]), HERE[2], 0.02, 0.03)
    belief = a_filter(start, particles=50_000)
    belief.propagate(way)
    pose, covariance = carried(HERE, np.diag([0.02, 0.02, 0.03]) ** 2, way)
    assert belief.poses.mean(axis=0) == pytest.approx(pose, abs=2e-3)
    assert np.cov(belief.poses.T) == pytest.approx(covariance, abs=2e-4)


@pytest.mark.slow
def test_the_likelihood_has_mean_one_over_the_map() -> None:
    rng = np.random.default_rng(0)
    # Cells, as the field has them.
    field = hills(PLACES, HERE)
    image = Likelihood.of(field, None, 0.0, uniform_density(PLACES), MonteCarloSettings(floor=0.01))
    flat = field.likelihood(field.votes.ravel(), floor=0.01)
    slope, level = image.wrong
    assert slope * flat.mean(dtype=np.float64) + level == pytest.approx(1.0, rel=1e-3)
    # The measured pose, over positions and headings.
    measured = Likelihood.of(image_of(HERE, covariance=np.diag([0.2, 0.2, 0.2]) ** 2), None, 0.0, uniform_density(PLACES),
                             MonteCarloSettings())  # fmt: skip
    poses = np.column_stack([PLACES.sample_uniform(200_000, rng), rng.uniform(-np.pi, np.pi, 200_000)])
    prior = Prior.of(CompactPoses.of(poses), np.full(len(poses), 1.0 / len(poses)))
    said, _ = measured.at_measured(poses, prior)
    assert said.mean() == pytest.approx(1.0, rel=0.1)


def test_particles_that_lie_far_apart_see_a_blurred_field() -> None:
    settings = MonteCarloSettings(annealing_m=0.1)
    field, uniform = hills(PLACES, HERE), uniform_density(PLACES)
    sharp, blurred = (Likelihood.of(field, None, gap, uniform, settings) for gap in (0.0, 0.3))
    near = CompactPoses.of(HERE[None] + np.array([[0.5, 0.0, 0.1]]))
    room = np.empty(1, dtype=np.float32)
    assert sharp.sharpness == 1.0
    assert blurred.sharpness == pytest.approx(0.1)
    assert blurred.by_votes(near, room.copy())[0] > 2.0 * sharp.by_votes(near, room.copy())[0]
    assert Likelihood.of(field, None, 0.3, uniform, MonteCarloSettings(annealing_m=0.0)).sharpness == 1.0


def test_the_density_of_a_belief_has_mass_one() -> None:
    rng = np.random.default_rng(1)
    poses = np.concatenate([HERE + 0.1 * rng.standard_normal((1500, 3)), THERE + 0.2 * rng.standard_normal((500, 3))])
    prior = Prior.of(CompactPoses.of(poses), np.full(2000, 1.0 / 2000))
    # By importance sampling from a wider distribution.
    wide = np.concatenate([HERE + 0.4 * rng.standard_normal((40_000, 3)), THERE + 0.5 * rng.standard_normal((40_000, 3))])
    density = 0.5 * gaussian(wide, HERE, 0.16 * np.eye(3)) + 0.5 * gaussian(wide, THERE, 0.25 * np.eye(3))
    assert (prior.density(wide) / density).mean() == pytest.approx(1.0, rel=0.1)
    assert prior.gap(2000) == pytest.approx((0.75 * 0.1 + 0.25 * 0.2) * np.sqrt(2.0) / 2000 ** (1 / 3), rel=0.1)


def test_cells_of_the_map_make_up_its_area() -> None:
    poses = PLACES.sample_uniform(1000, np.random.default_rng(0))
    extent = np.ptp(PLACES.positions, axis=0) + 2.0 * PLACES.reach
    assert np.ptp(poses, axis=0) == pytest.approx(extent, rel=0.1)
    area = 1.0 / (uniform_density(PLACES) * 2.0 * np.pi)
    assert 0.7 * np.prod(extent) < area <= 1.001 * np.prod(extent)
