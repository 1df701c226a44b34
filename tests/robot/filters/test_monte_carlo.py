import numpy as np
import pytest
from oracles.fields import STANDING, hills, moved
from oracles.scenes import grid

from panoloc_mcl.robot.filters import MonteCarloFilter, Start, Status
from panoloc_mcl.robot.geometry import angle_difference, between, compose
from panoloc_mcl.robot.observation import Places, VoteField
from panoloc_mcl.robot.observation.field import silent_field
from panoloc_mcl.robot.settings.localizer import (
    AdaptiveSettings,
    MonteCarloSettings,
    RecoverySettings,
    ResamplingSettings,
    StatusSettings,
)

PLACES = Places(grid(6, 5))
HERE, THERE = np.array([1.0, 1.0, 0.5]), np.array([4.0, 3.0, -2.5])
STEP = moved(0.0, 0.0, 0.0)  # no motion, but some noise


def a_filter(start: Start | None = None, seed: int = 0, **settings) -> MonteCarloFilter:
    settings.setdefault("particles", 1000)
    # These fields are made by hand: images that have nothing to do with each other.
    settings.setdefault("correlated", False)
    chosen = MonteCarloSettings(**settings)
    return MonteCarloFilter(PLACES, start or Start(), chosen, StatusSettings(), np.random.default_rng(seed))


def error(pose: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    return float(np.hypot(*(pose[:2] - truth[:2]))), abs(float(angle_difference(pose[2], truth[2])))


def near(pose: np.ndarray, truth: np.ndarray, metres: float = 0.2, degrees: float = 5.0) -> bool:
    far, off = error(pose, truth)
    return far < metres and off < np.radians(degrees)


def uniform_field(level: float = 0.5) -> VoteField:
    field = hills(PLACES, HERE)
    return VoteField(np.full_like(field.votes, level), field.headings, PLACES, field.tolerance)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("heading", [0.5, np.pi, -3.1])
def test_one_peak_is_found(seed: int, heading: float) -> None:
    belief = a_filter(seed=seed)
    truth = np.array([2.0, 3.0, heading])
    for _ in range(5):
        belief.propagate(STEP)
        belief.update(hills(PLACES, truth))
    state = belief.state()
    assert state.status is Status.CONVERGED
    assert near(state.clusters[0].pose, truth)
    assert PLACES.positions[state.best_place] == pytest.approx(truth[:2])
    assert state.best_place_votes > 0.7


@pytest.mark.parametrize("seed", range(5))
def test_a_drive_is_followed(seed: int) -> None:
    belief = a_filter(seed=seed)
    truth = np.array([0.5, 0.5, 0.0])
    rng = np.random.default_rng(seed)
    for frame in range(25):
        way = np.array([0.2, 0.0, 0.05])
        truth = compose(truth, way)
        seen = way + rng.normal(0.0, [0.01, 0.01, 0.005])
        belief.propagate(moved(*seen))
        belief.update(hills(PLACES, truth))
        if frame > 5:
            state = belief.state()
            assert near(state.clusters[0].pose, truth, 0.3, 8.0)
            assert state.status is Status.CONVERGED


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("particles", [1000, 60_000])
def test_two_equal_peaks_are_ambiguous_and_never_their_mean(seed: int, particles: int) -> None:
    belief = a_filter(seed=seed, particles=particles)
    ambiguous = 0
    for _ in range(4):
        belief.propagate(STEP)
        belief.update(hills(PLACES, HERE, THERE))
        state = belief.state()
        assert near(state.clusters[0].pose, HERE, 0.3, 8.0) or near(state.clusters[0].pose, THERE, 0.3, 8.0)
        ambiguous += state.status is Status.AMBIGUOUS
    assert ambiguous == 4


def test_even_without_resampling_the_mean_of_two_is_never_reported() -> None:
    belief = a_filter(particles=20_000, resampling=ResamplingSettings(below=0.0))
    for _ in range(3):
        belief.update(hills(PLACES, HERE, THERE))
    pose = belief.state().clusters[0].pose
    assert near(pose, HERE) or near(pose, THERE)


@pytest.mark.parametrize("seed", range(3))
def test_when_one_of_two_peaks_goes_the_other_is_taken(seed: int) -> None:
    belief = a_filter(seed=seed)
    for field in (hills(PLACES, HERE, THERE), hills(PLACES, THERE), hills(PLACES, THERE)):
        belief.propagate(STEP)
        belief.update(field)
    assert belief.state().status is Status.CONVERGED
    assert near(belief.state().clusters[0].pose, THERE)


def test_a_uniform_field_leaves_it_searching() -> None:
    belief = a_filter()
    for _ in range(10):
        belief.propagate(STEP)
        belief.update(uniform_field())
        assert belief.state().status is Status.SEARCHING


@pytest.mark.parametrize("seed", range(5))
def test_after_a_kidnap_it_finds_itself_again(seed: int) -> None:
    belief = a_filter(seed=seed)
    for _ in range(6):
        belief.propagate(STEP)
        belief.update(hills(PLACES, HERE))
    assert near(belief.state().clusters[0].pose, HERE)
    matches = []
    for _ in range(6):
        belief.propagate(STEP)
        belief.update(hills(PLACES, THERE))
        matches.append(belief.state().match)
    # The first image is told to be a surprise, the last one is none any more.
    assert matches[0] < 0.05 < matches[-1]
    assert belief.state().status is Status.CONVERGED
    assert near(belief.state().clusters[0].pose, THERE)


def test_without_recovery_a_kidnapped_robot_is_reported_lost() -> None:
    belief = a_filter(Start((1.0, 1.0), 0.5), recovery=RecoverySettings(min_share=0.0, max_share=0.0))
    for _ in range(3):
        belief.update(hills(PLACES, HERE))
    assert belief.state().status is Status.CONVERGED
    for _ in range(10):
        belief.propagate(STEP)
        belief.update(hills(PLACES, THERE))
        assert belief.state().injected == 0
    assert belief.state().status is Status.LOST
    for _ in range(10):
        belief.update(hills(PLACES, HERE))
    assert belief.state().status is Status.CONVERGED


def test_an_image_that_says_nothing_changes_nothing() -> None:
    belief = a_filter()
    belief.update(hills(PLACES, HERE, THERE))
    poses, weights, before = belief.poses.copy(), belief.weights.copy(), belief.state()
    belief.update(silent_field(hills(PLACES, HERE).headings, PLACES, "image is black", full_circle=True))
    after = belief.state()
    assert np.array_equal(belief.poses, poses)
    assert np.array_equal(belief.weights, weights)
    assert after.status is before.status
    assert np.array_equal(after.clusters[0].pose, before.clusters[0].pose)
    assert np.isnan(after.match)
    assert np.isnan(after.best_place_votes)
    assert (after.injected, after.resampled) == (0, False)


def test_standing_still_changes_no_bit_and_draws_no_number() -> None:
    belief, other = a_filter(), a_filter()
    poses = belief.poses.copy()
    for _ in range(100):
        belief.propagate(STANDING)
    assert np.array_equal(belief.poses, poses)
    for one in (belief, other):
        one.propagate(STEP)
    assert np.array_equal(belief.poses, other.poses)


@pytest.mark.parametrize("floor", [0.0, 0.005, 0.5])
def test_particles_that_all_miss_stay_finite(floor: float) -> None:
    belief = a_filter(Start((1.0, 1.0), 0.5, 0.01, 0.01), floor=floor, recovery=RecoverySettings(min_share=0.0, max_share=0.0))
    # So sharp a field that exp() of every particle's log-likelihood is 0.
    sharp = hills(PLACES, THERE, tolerance=0.001)
    for _ in range(3):
        belief.update(sharp)
        state = belief.state()
        assert (belief.weights > 0.0).all()
        assert np.isfinite(belief.weights).all()
        assert np.isfinite(state.clusters[0].pose).all()
        assert 0.0 < state.effective_count <= 1000 + 1e-6
        assert 0.0 <= state.match <= 1.0


def test_the_floor_bounds_what_one_image_can_say() -> None:
    belief = a_filter(
        Start((1.0, 1.0), 0.5),
        floor=0.1,
        resampling=ResamplingSettings(below=0.0),
        recovery=RecoverySettings(min_share=0.0, max_share=0.0),
    )
    belief.update(hills(PLACES, HERE))
    assert np.ptp(np.log(belief.weights)) <= np.log(1.0 / 0.1) + 1e-6


def test_a_late_image_weighs_where_the_robot_was_then() -> None:
    then = np.array([2.0, 2.0, 0.5])
    way = np.array([0.8, 0.1, 0.4])
    now = compose(then, way)
    back = moved(*between(way, np.zeros(3)))
    belief = a_filter()
    for _ in range(6):
        belief.propagate(STEP)
        belief.update(hills(PLACES, then), back)
    assert near(belief.state().clusters[0].pose, now)
    # The same images without the way in between say something else.
    deaf = a_filter()
    for _ in range(6):
        deaf.propagate(STEP)
        deaf.update(hills(PLACES, then))
    assert near(deaf.state().clusters[0].pose, then)
    assert error(then, now)[0] > 0.5


def test_the_same_seed_gives_the_same_result_and_another_one_not() -> None:
    def run(seed: int) -> np.ndarray:
        belief = a_filter(seed=seed)
        for _ in range(4):
            belief.propagate(moved(0.1, 0.0, 0.05))
            belief.update(hills(PLACES, HERE, THERE))
        return belief.poses

    assert np.array_equal(run(3), run(3))
    assert not np.array_equal(run(3), run(4))


def test_asking_for_the_state_changes_nothing() -> None:
    asked, silent = a_filter(), a_filter()
    for belief in (asked, silent):
        for _ in range(4):
            belief.propagate(STEP)
            belief.update(hills(PLACES, HERE))
            if belief is asked:
                belief.state()
                belief.state()
    assert np.array_equal(asked.poses, silent.poses)
    assert asked.state().status is silent.state().status


@pytest.mark.parametrize(
    ("start", "sd"),
    [
        (Start((2.0, 3.0), 1.0, 0.3, 0.1), (0.3, 0.1)),
        (Start((2.0, 3.0), None, 0.3), (0.3, None)),
        (Start(None, 1.0), (None, np.radians(5.0))),
    ],
)
def test_the_start_is_drawn_as_wide_as_it_is_known(start: Start, sd: tuple) -> None:
    belief = a_filter(start, particles=5000)
    if sd[0] is not None:
        assert belief.poses[:, :2].mean(axis=0) == pytest.approx(start.position, abs=0.03)
        assert belief.poses[:, :2].std(axis=0) == pytest.approx([sd[0]] * 2, rel=0.1)
    else:
        assert len(np.unique(PLACES.nearest(belief.poses[:, :2]))) == len(PLACES)
    if sd[1] is not None:
        assert start.heading is not None
        assert angle_difference(belief.poses[:, 2], start.heading).std() == pytest.approx(sd[1], rel=0.1)
    else:
        # The mean of unit vectors of uniform directions is short.
        assert abs(np.exp(1j * belief.poses[:, 2]).mean()) < 0.06


def test_the_injected_share_stays_within_its_bounds() -> None:
    recovery = RecoverySettings(min_share=0.05, max_share=0.3)
    assert _injections(a_filter(recovery=recovery), [HERE])[0] == 300  # nothing known at the start
    injected = _injections(a_filter(Start((1.0, 1.0), 0.5), recovery=recovery), [HERE] * 6 + [THERE] * 6)
    assert injected[:6] == [50] * 6
    assert 100 < max(injected[6:]) <= 300
    assert injected[-1] == 50


def _injections(belief: MonteCarloFilter, truths: list[np.ndarray]) -> list[int]:
    injected = []
    for truth in truths:
        belief.propagate(STEP)
        belief.update(hills(PLACES, truth))
        injected.append(belief.state().injected)
    return injected


def test_a_known_start_is_not_searched_for() -> None:
    belief = a_filter(Start((1.0, 1.0), 0.5))
    belief.update(hills(PLACES, HERE))
    assert belief.state().injected == 20  # the least share


@pytest.mark.parametrize("scheme", ["systematic", "stratified", "residual", "multinomial"])
@pytest.mark.parametrize("seed", range(3))
def test_every_scheme_finds_the_peak(scheme: str, seed: int) -> None:
    belief = a_filter(seed=seed, resampling=ResamplingSettings(scheme=scheme))
    for _ in range(5):
        belief.propagate(STEP)
        belief.update(hills(PLACES, HERE))
    assert near(belief.state().clusters[0].pose, HERE)
    assert belief.state().status is Status.CONVERGED


@pytest.mark.parametrize(("below", "resampled"), [(0.0, False), (1.0, True)])
def test_the_threshold_decides_when_to_resample(below: float, resampled: bool) -> None:
    belief = a_filter(resampling=ResamplingSettings(below=below))
    for _ in range(4):
        belief.propagate(STEP)
        belief.update(hills(PLACES, HERE))
        assert belief.state().resampled is resampled
        assert belief.state().particle_count == 1000


def test_an_adaptive_count_follows_the_belief() -> None:
    adaptive = AdaptiveSettings(enabled=True, min_particles=300, max_particles=4000)
    belief = a_filter(particles=1000, adaptive=adaptive)
    belief.update(uniform_field())
    spread_out = belief.state().particle_count
    for _ in range(6):
        belief.propagate(STEP)
        belief.update(hills(PLACES, HERE))
    found = belief.state()
    assert spread_out == 4000
    assert 300 <= found.particle_count < 2000
    assert near(found.clusters[0].pose, HERE)
    assert len(belief.poses) == len(belief.weights) == found.particle_count
    divided = a_filter(particles=1000, adaptive=adaptive)
    for _ in range(6):
        divided.propagate(STEP)
        divided.update(hills(PLACES, HERE, THERE))
    assert divided.state().particle_count > found.particle_count


def test_weights_are_shares() -> None:
    belief = a_filter(resampling=ResamplingSettings(below=0.0))
    for _ in range(4):
        belief.propagate(STEP)
        belief.update(hills(PLACES, HERE, THERE))
        assert belief.weights.dtype == np.float32
        assert belief.weights.sum(dtype=np.float64) == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize("particles", [1000, 70_000])
def test_threads_change_no_bit(particles: int) -> None:
    beliefs = [a_filter(particles=particles, threads=threads) for threads in (1, 2, 3)]
    for step in range(4):
        for belief in beliefs:
            belief.propagate(moved(0.1, 0.0, 0.05))
            belief.update(hills(PLACES, HERE, THERE) if step % 2 else hills(PLACES, HERE))
    one, *others = beliefs
    for other in others:
        assert np.array_equal(one.poses, other.poses)
        assert np.array_equal(one.weights, other.weights)
        assert np.array_equal(one.state().clusters[0].pose, other.state().clusters[0].pose)


def test_what_is_drawn_for_one_particle_does_not_depend_on_how_many_there_are() -> None:
    few, many = a_filter(Start((1.0, 1.0), 0.5), particles=100), a_filter(Start((1.0, 1.0), 0.5), particles=5000)
    before = few.poses
    some, arrays = few.snapshot()[0], dict(many.snapshot()[0])
    for name in ("x", "y", "turns"):
        arrays[name] = np.r_[some[name], arrays[name][100:]]
    many.restore(arrays, many.snapshot()[1])
    for belief in (few, many):
        belief.propagate(moved(0.1, 0.0, 0.05))
    assert np.array_equal(few.poses, many.poses[:100])
    assert not np.array_equal(few.poses, before)


def test_injection_takes_every_particle_as_often() -> None:
    """Which particles are replaced depends neither on their weight nor on their place in the row."""
    counts = np.zeros(100)
    for seed in range(600):
        belief = a_filter(
            Start((1.0, 1.0), 0.5), seed=seed, particles=100,
            resampling=ResamplingSettings(below=0.0), recovery=RecoverySettings(min_share=0.1, max_share=0.1),
        )  # fmt: skip
        before = belief.poses.copy()
        belief.update(hills(PLACES, THERE))
        counts += np.any(belief.poses != before, axis=1)
    assert counts.sum() == 6000
    # Six standard deviations of a binomial count.
    assert np.all(np.abs(counts - 60.0) < 6.0 * np.sqrt(60.0))


def test_restored_it_goes_on_as_if_nothing_had_happened() -> None:
    one, other = a_filter(seed=3, particles=500), a_filter(seed=4, particles=700)
    for _ in range(3):
        one.propagate(moved(0.1, 0.0, 0.05))
        one.update(hills(PLACES, HERE, THERE))
    told = one.state()
    arrays, header = one.snapshot()
    other.restore({name: array.copy() for name, array in arrays.items()}, header)
    assert other.state().best_place_votes == told.best_place_votes
    for belief in (one, other):
        belief.propagate(moved(0.1, 0.0, 0.05))
        belief.update(hills(PLACES, THERE))
    assert np.array_equal(one.poses, other.poses)
    assert np.array_equal(one.weights, other.weights)
    assert one.state().match == other.state().match


@pytest.mark.parametrize("spoil", ["x", "turns", "weights", "origin", "header"])
def test_a_state_that_does_not_fit_changes_nothing(spoil: str) -> None:
    belief = a_filter()
    arrays, header = belief.snapshot()
    arrays, header = {name: array.copy() for name, array in arrays.items()}, dict(header)
    if spoil == "header":
        del header["fit"]
    else:
        arrays[spoil] = arrays[spoil][:-1]
    before = belief.poses.copy()
    with pytest.raises((KeyError, ValueError)):
        belief.restore(arrays, header)
    assert np.array_equal(belief.poses, before)


@pytest.mark.parametrize("form", ["monte_carlo/4", "monte_carlo/3"])
def test_a_state_of_a_form_before_is_read(form: str) -> None:
    belief, other = a_filter(seed=3, particles=500), a_filter(seed=4, particles=700)
    for _ in range(3):
        belief.propagate(moved(0.1, 0.0, 0.05))
        belief.update(hills(PLACES, HERE, THERE))
    _, header = belief.snapshot()
    # Poses as columns, and logarithms of weights up to a constant.
    arrays = {"poses": belief.poses, "log_weights": np.log(belief.weights.astype(np.float64)) + 5.0}
    other.restore(arrays, {**header, "form": form})
    assert np.array_equal(other.poses, belief.poses)
    assert other.weights == pytest.approx(belief.weights, rel=1e-6)
    assert other.state().match == belief.state().match
