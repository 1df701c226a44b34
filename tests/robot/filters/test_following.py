"""What stands for a tracker: places that follow odometry, and headings that have the votes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.scenes import grid

from panoloc_mcl.robot.filters import KalmanOrientationFilter, Start, Status
from panoloc_mcl.robot.filters.following import Following, _share, missed, support_of
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation import Places, VoteField
from panoloc_mcl.robot.observation.field import silent_field
from panoloc_mcl.robot.settings.localizer import KalmanSettings, StatusSettings

# 4 m x 4 m, a place every .25 m, as a map with virtual places has them.
PLACES = Places(0.25 * grid(17, 17))
SURE = 1.0 - StatusSettings().lost_chance


def drive(metres: float, turn: float = 0.0) -> Motion:
    sd = 0.15 * metres
    return Motion(
        np.array([metres, 0.0, turn]),
        along=metres,
        sd_along=sd,
        sd_across=sd / 3.0,
        distance=metres,
        turn=abs(turn),
        duration_s=1.0,
    )


def nearest(position) -> int:
    return int(PLACES.nearest(np.asarray(position, dtype=np.float64)[None])[0])


class Robot:
    """Drives a circle of 1.2 m radius; images show the nearest place, or what is asked for."""

    def __init__(self, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.angle = 0.0
        self.following = Following.begun(tuple(self.position.tolist()), 0.2)

    @property
    def position(self):
        return np.array([2.0 + 1.2 * math.cos(self.angle), 2.0 + 1.2 * math.sin(self.angle)])

    @property
    def heading(self) -> float:
        return self.angle + 0.5 * math.pi

    def on(self, place: int | None = None, support: float = 3.0, metres: float = 0.4, wrong_by: float = 0.0) -> Following:
        chord = 2.4 * math.sin(0.5 * metres / 1.2)
        half = 0.5 * metres / 1.2
        motion = drive(chord * float(self.rng.normal(1.0, 0.05)))
        self.following = self.following.moved(motion, self.heading + half + wrong_by, 0.07)
        self.angle += metres / 1.2
        shown = nearest(self.position + self.rng.normal(0.0, 0.07, 2)) if place is None else place
        self.following = self.following.seen(shown, PLACES, support, 1e-4)
        return self.following

    def anywhere(self, support: float = 1.0) -> Following:
        return self.on(int(self.rng.integers(len(PLACES))), support)


def test_who_is_right_stays_sure_for_hours() -> None:
    robot = Robot()
    chances = [robot.on().right for _ in range(2000)]
    assert min(chances) > SURE
    off = np.hypot(*(robot.following.position - robot.position))
    assert off < 3.0 * robot.following.spread_m


def test_who_stands_stays_sure() -> None:
    robot = Robot()
    robot.on()
    for _ in range(500):
        assert robot.on(metres=0.0).right > SURE


def test_who_turns_on_the_spot_without_support_stays_sure() -> None:
    """Models that do not know of other headings neither help nor harm."""
    robot = Robot()
    assert min(robot.on(metres=0.0, support=1.0).right for _ in range(200)) > SURE


def test_places_that_are_anywhere_are_noticed_within_three_images() -> None:
    """Unless one lies on the track by luck."""
    late = 0
    for seed in range(200):
        robot = Robot(seed)
        for _ in range(10):
            robot.on()
        late += [robot.anywhere().right for _ in range(3)][-1] > SURE
    assert late <= 10


@pytest.mark.slow
def test_they_do_not_make_sure_again_by_luck() -> None:
    robot, sure = Robot(1), 0
    for _ in range(20):
        robot.anywhere()
    for _ in range(20_000):
        sure += robot.anywhere().right > SURE
    assert sure <= 20


def test_a_place_that_stays_while_odometry_goes_on_is_noticed() -> None:
    for seed in range(20):
        robot = Robot(seed)
        for _ in range(10):
            robot.on()
        stuck = nearest(robot.position)
        after = [robot.on(stuck, support=1.0).right for _ in range(12)]
        assert max(after[4:]) < SURE


@pytest.mark.parametrize("wrong_by", [60.0, 90.0, 180.0])
def test_a_heading_that_leads_elsewhere_than_the_places_go_is_noticed(wrong_by: float) -> None:
    robot = Robot()
    for _ in range(10):
        robot.on(wrong_by=math.radians(wrong_by), support=1.0)
    assert robot.following.right < SURE


def test_one_wrong_place_is_forgiven_once_the_next_one_is_right() -> None:
    robot = Robot()
    for _ in range(10):
        robot.on()
    robot.on(nearest((0.2, 3.8)), support=1.0)
    track = robot.following.position
    assert np.hypot(*(track - robot.position)) < 0.3
    assert robot.on().right > SURE


def test_in_a_map_that_looks_alike_when_turned_places_alone_do_not_make_sure() -> None:
    """All goes well, half a turn about the middle: only votes at other headings can tell."""
    for support, comes_back in ((1.0, False), (0.7, False), (8.0, True)):
        robot = Robot(2)
        for _ in range(20):
            robot.anywhere()
        sure = [robot.on(support=support).right > SURE for _ in range(12)]
        assert sure[-1] == comes_back
        assert any(sure) == comes_back


def test_images_that_say_nothing_leave_doubt() -> None:
    robot = Robot()
    robot.on()
    seen = [robot.following]
    for _ in range(20):
        seen.append(seen[-1].unseen())
        assert seen[-1].chances.sum() == pytest.approx(1.0)
    assert [one.right for one in seen] == sorted((one.right for one in seen), reverse=True)
    assert seen[-1].right < SURE


@given(st.floats(0.5, 3.5), st.floats(0.5, 3.5), st.floats(0.25, 30.0), st.floats(0.25, 30.0), st.floats(-0.5, 0.5))
@settings(max_examples=60, deadline=None)
def test_shares_of_all_places_are_one_inside_and_nothing_far_outside(x, y, sx, sy, correlation) -> None:
    covariance = np.array([[sx**2, correlation * sx * sy], [correlation * sx * sy, sy**2]])
    mean = np.array([x, y])
    at = PLACES.positions[nearest(mean)]
    shares = sum(_share(place, PLACES, mean, covariance, at) for place in range(len(PLACES)))
    assert shares == pytest.approx(1.0, abs=0.25)
    far = mean + np.array([20.0 * sx + 8.0, 0.0])
    at = PLACES.positions[nearest(far)]
    assert sum(_share(place, PLACES, far, covariance, at) for place in range(len(PLACES))) < 0.2


@pytest.mark.parametrize(("sd_deg", "draws"), [(4.0, 1), (10.0, 5), (30.0, 5), (104.0, 5), (20.0, 1)])
def test_the_chance_that_no_heading_was_near_is_that_of_a_trial(sd_deg: float, draws: int) -> None:
    rng = np.random.default_rng(0)
    truth = rng.normal(0.0, sd_deg, (200_000, 1))
    near = (np.abs(rng.normal(0.0, sd_deg, (200_000, draws)) - truth) < 10.0).any(axis=1)
    counted = missed(math.radians(sd_deg), draws)
    # One draw exactly; several share the truth, which makes them fail together more often.
    assert counted == pytest.approx(1.0 - near.mean(), abs=0.005 if draws == 1 else 0.13)
    assert missed(0.0, draws) == 0.0


def test_votes_support_the_heading_that_has_them_and_never_prove_it() -> None:
    assert support_of(0.5, 0.5, 0.1) == 1.0
    assert support_of(0.6, 0.1, 0.05) == pytest.approx(10.0, rel=0.01)
    assert support_of(0.1, 0.6, 0.05) == pytest.approx(0.1, rel=0.01)
    assert support_of(0.5, 0.45, 0.1) * support_of(0.45, 0.5, 0.1) == pytest.approx(1.0)


def test_what_is_saved_is_all_of_it() -> None:
    robot = Robot()
    for _ in range(5):
        robot.on()
    again = Following.of_array(robot.following.array())
    for _ in range(3):
        np.testing.assert_array_equal(again.array(), robot.following.array())
        robot.on()
        again = robot.following
    with pytest.raises(ValueError, match="shape"):
        Following.of_array(np.zeros(3))
    begun = Following.of_array(Following.begun(None, 0.2).array())
    assert not np.isfinite(begun.spread_m)


def a_filter(position=(1.0, 1.0), heading: float | None = 0.0) -> KalmanOrientationFilter:
    return KalmanOrientationFilter(
        PLACES, Start(position, heading), KalmanSettings(), StatusSettings(), np.random.default_rng(0)
    )


def seen(heading: float, place: int, elsewhere: float = 0.1) -> VoteField:
    votes = np.full((1, len(PLACES)), 0.05, dtype=np.float32)
    votes[0, place] = 0.5
    around = np.full(90, elsewhere, dtype=np.float32)
    around[round(heading * 90 / (2.0 * math.pi)) % 90] = 0.5
    return VoteField(votes, np.array([heading]), PLACES, 0.08, full_circle=False, at_every_heading=around)


def test_a_tracker_that_is_carried_off_says_so_and_is_found_again_where_the_map_tells() -> None:
    belief, where, step = a_filter(), np.array([1.0, 1.0]), np.array([0.4, 0.0])
    for _ in range(4):
        where = where + step
        belief.propagate(drive(0.4))
        belief.update(seen(0.0, nearest(where)))
        assert belief.state().status is Status.CONVERGED
    rng = np.random.default_rng(1)
    for _ in range(3):
        belief.propagate(drive(0.4))
        belief.update(seen(0.0, int(rng.integers(len(PLACES))), elsewhere=0.5))
    assert belief.state().status is Status.LOST
    assert belief.state().elsewhere > 0.5
    where = np.array([0.5, 3.0])
    step, statuses = np.array([0.3, 0.0]), []
    for _ in range(10):
        where = where + step
        belief.propagate(drive(0.3))
        belief.update(seen(0.0, nearest(where)))
        statuses.append(belief.state().status)
    assert statuses[0] is Status.LOST
    assert statuses[-1] is Status.CONVERGED


def test_a_place_off_the_track_is_not_called_the_pose() -> None:
    belief = a_filter()
    belief.propagate(drive(0.4))
    belief.update(seen(0.0, nearest((1.4, 1.0))))
    assert belief.state().status is Status.CONVERGED
    belief.propagate(drive(0.4))
    belief.update(seen(0.0, nearest((3.9, 3.9))))
    assert belief.state().status is Status.LOST


def test_a_place_that_odometry_has_left_behind_is_not_called_the_pose() -> None:
    belief = a_filter()
    belief.update(seen(0.0, nearest((1.0, 1.0))))
    assert belief.state().status is Status.CONVERGED
    for _ in range(3):
        belief.propagate(drive(0.3))
        belief.update(silent_field(np.zeros(1), PLACES, "image is black", False))
    assert belief.state().status is Status.LOST


def test_a_start_without_a_heading_is_not_sure_of_the_first_that_comes() -> None:
    belief = a_filter(None, None)
    for _ in range(100):
        (heading, *_) = belief.heading_hypotheses(None)
        belief.update(seen(float(heading), nearest((1.0, 1.0)), elsewhere=0.5))
        assert belief.state().status is Status.SEARCHING


def test_a_state_of_the_form_before_is_read() -> None:
    one, other = a_filter(), a_filter()
    for _ in range(2):
        one.propagate(drive(0.4))
        one.update(seen(0.0, nearest((1.4, 1.0))))
    arrays, header = one.snapshot()
    del arrays["following"]
    other.restore(arrays, header | {"form": "kalman_orientation/2"})
    assert other.state().status is Status.CONVERGED
    np.testing.assert_array_equal(other.state().clusters[0].pose, one.state().clusters[0].pose)
