import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from oracles.scenes import grid

from panoloc_mcl.robot.filters import KalmanOrientationFilter, Start, Status
from panoloc_mcl.robot.geometry import angle_difference, wrap_angle
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation import Places, VoteField
from panoloc_mcl.robot.observation.field import silent_field
from panoloc_mcl.robot.settings.localizer import KalmanSettings, StatusSettings

PLACES = Places(grid(3, 2))
NOISE = math.radians(KalmanSettings().measurement_noise_deg)


def a_filter(heading: float | None = 0.0, sd: float = 0.1, seed: int = 0, **settings) -> KalmanOrientationFilter:
    return KalmanOrientationFilter(
        PLACES, Start(None, heading, sd_heading=sd), KalmanSettings(**settings), StatusSettings(), np.random.default_rng(seed)
    )


def measured(heading: float, place: int = 4, votes: float = 0.8) -> VoteField:
    """A field over three headings, the middle one best."""
    table = np.full((3, len(PLACES)), 0.1, dtype=np.float32)
    table[1, place] = votes
    return VoteField(table, wrap_angle(np.array([heading - 0.3, heading, heading + 0.3])), PLACES, 0.1, full_circle=False)


def turned(turn: float, sd: float = 0.0, seconds: float = 0.1) -> Motion:
    increment = np.array([0.0, 0.0, turn])
    return Motion(increment, last_turn=turn, sd_last_turn=sd, turn=abs(turn), duration_s=seconds)


@settings(max_examples=60, deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(-1.0, 1.0), st.floats(0.01, 1.0))
def test_the_update_is_the_product_of_two_gaussians(heading: float, residual: float, sd: float) -> None:
    belief = a_filter(heading, sd)
    belief.update(measured(heading + residual))
    # Precisions add; means are weighted by precision. Everywhere on the circle.
    prior, seen = 1.0 / sd**2, 1.0 / NOISE**2
    assert belief.sd_heading == pytest.approx(1.0 / math.sqrt(prior + seen))
    moved_by = float(angle_difference(belief.heading, heading))
    assert moved_by == pytest.approx(residual * seen / (prior + seen), abs=1e-9)
    assert -math.pi <= belief.heading < math.pi


def test_over_the_seam_it_goes_the_short_way() -> None:
    belief = a_filter(math.pi - 0.05, 0.2)
    belief.update(measured(-math.pi + 0.05))
    assert abs(abs(belief.heading) - math.pi) < 0.06


@settings(max_examples=30, deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(-4.0, 4.0), st.floats(0.0, 0.5))
def test_the_prediction_turns_and_widens(heading: float, turn: float, sd: float) -> None:
    belief = a_filter(heading, 0.1)
    belief.propagate(turned(turn, sd))
    assert abs(float(angle_difference(belief.heading, heading + turn))) < 1e-12
    assert belief.sd_heading == pytest.approx(math.hypot(0.1, sd))


def test_standing_still_changes_nothing() -> None:
    belief = a_filter(1.234)
    for _ in range(50):
        belief.propagate(turned(0.0))
    assert (belief.heading, belief.sd_heading) == (1.234, 0.1)


def test_no_heading_is_less_certain_than_the_uniform_one() -> None:
    belief = a_filter(0.0, 0.1)
    for _ in range(100):
        belief.propagate(turned(1.0, 1.0))
    assert belief.sd_heading == pytest.approx(math.pi / math.sqrt(3.0))
    assert a_filter(None).sd_heading == pytest.approx(math.pi / math.sqrt(3.0))


@pytest.mark.parametrize("heading", [0.0, math.pi])
def test_headings_are_drawn_from_the_prediction(heading: float) -> None:
    belief = a_filter(heading, 0.2, headings=1000)
    drawn = belief.heading_hypotheses(None)
    assert drawn.shape == (1000,)
    assert np.all((drawn >= -math.pi) & (drawn < math.pi))
    off = angle_difference(drawn, heading)
    # Six standard errors each.
    assert abs(off.mean()) < 6.0 * 0.2 / math.sqrt(1000)
    assert off.std() == pytest.approx(0.2, rel=6.0 / math.sqrt(2000))
    assert a_filter().heading_hypotheses(None).shape == (KalmanSettings().headings,)


def test_a_certain_filter_still_looks_around_a_little() -> None:
    drawn = a_filter(0.0, 1e-9, headings=1000, min_sd_deg=2.0).heading_hypotheses(None)
    assert np.degrees(drawn.std()) == pytest.approx(2.0, rel=6.0 / math.sqrt(2000))


def test_a_late_image_measures_the_heading_it_saw() -> None:
    # Since the image the robot has turned by 0.6: at the image's time the belief looked 0.6 less far left.
    since = turned(-0.6, seconds=-0.3)
    belief = a_filter(1.0, 0.2, headings=500)
    drawn = belief.heading_hypotheses(since)
    assert abs(float(angle_difference(drawn, 0.4).mean())) < 6.0 * 0.2 / math.sqrt(500)
    on_time = a_filter(1.0, 0.2)
    on_time.update(measured(1.1))
    belief.update(measured(0.5), since)
    assert belief.heading == pytest.approx(on_time.heading, abs=1e-9)
    assert belief.sd_heading == pytest.approx(on_time.sd_heading)


def test_the_best_response_gives_the_place() -> None:
    belief = a_filter()
    assert belief.state().status is Status.SEARCHING
    belief.update(measured(0.02, place=5, votes=0.7))
    state = belief.state()
    assert state.best_place == 5
    assert state.best_place_votes == pytest.approx(0.7)
    assert state.clusters[0].pose[:2] == pytest.approx(PLACES.positions[5])
    assert state.status is Status.CONVERGED
    assert state.clusters[0].mass == 1.0


@pytest.mark.parametrize(
    "field",
    [
        silent_field(np.zeros(3), PLACES, "image is black", False),
        VoteField(np.zeros((3, 6), np.float32), np.zeros(3), PLACES, 1.0, False),
    ],
)
def test_an_image_that_says_nothing_changes_nothing(field: VoteField) -> None:
    belief = a_filter(0.3)
    belief.update(measured(0.35, place=2))
    heading, sd = belief.heading, belief.sd_heading
    belief.update(field)
    assert (belief.heading, belief.sd_heading) == (heading, sd)
    assert belief.state().best_place == 2
    assert math.isnan(belief.state().match)
    assert math.isnan(belief.state().best_place_votes)


def test_it_says_lost_when_the_heading_has_become_uncertain() -> None:
    belief = a_filter()
    belief.update(measured(0.0))
    assert belief.state().status is Status.CONVERGED
    belief.propagate(turned(0.0, 1.0))
    assert belief.state().status is Status.LOST


def test_a_start_position_names_the_first_place() -> None:
    start = Start((1.9, 0.9), 0.0)
    belief = KalmanOrientationFilter(PLACES, start, KalmanSettings(), StatusSettings(), np.random.default_rng(0))
    assert belief.state().best_place == 5


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-math.pi, math.pi),
    st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(0.0, 0.3), st.floats(-0.5, 0.5)), min_size=2, max_size=8),
    st.data(),
)
def test_in_whatever_order_images_come_the_belief_ends_the_same(heading: float, frames: list, data: st.DataObject) -> None:
    """Every image is fused at its own time: one that was held back ends where one in order does."""
    # Where residuals may come near to half a turn, either side of it could be the shorter way.
    assume(sum(abs(error) for _, _, error in frames) <= 2.0)
    held = data.draw(st.integers(0, len(frames) - 2))
    seen, truth = [], heading
    for turn, _, error in frames:
        truth += turn
        seen.append(measured(truth + error))
    ordered, late = a_filter(heading), a_filter(heading)
    for index, ((turn, sd, _), field) in enumerate(zip(frames, seen, strict=True)):
        for belief in (ordered, late):
            belief.propagate(turned(turn, sd))
        ordered.update(field)
        if index != held:
            late.update(field)
    back = frames[held + 1 :]
    sd = math.sqrt(sum(sd**2 for _, sd, _ in back))
    late.update(seen[held], turned(-sum(turn for turn, _, _ in back), sd, seconds=-0.1 * len(back)))
    assert late.sd_heading == pytest.approx(ordered.sd_heading)
    assert abs(float(angle_difference(late.heading, ordered.heading))) < 1e-6


def test_an_image_from_between_two_others_is_fused_between_them() -> None:
    # Three steps of 0.2 rad and 0.1 s; the image is from the middle of the second.
    late, ordered = a_filter(0.0), a_filter(0.0)
    for _ in range(3):
        late.propagate(turned(0.2, 0.1))
    late.update(measured(0.35), turned(-0.3, 0.1 * math.sqrt(1.5), seconds=-0.15))
    half = 0.1 * math.sqrt(0.5)
    for step in (turned(0.2, 0.1), turned(0.1, half, 0.05)):
        ordered.propagate(step)
    ordered.update(measured(0.35))
    for step in (turned(0.1, half, 0.05), turned(0.2, 0.1)):
        ordered.propagate(step)
    assert (late.heading, late.sd_heading) == pytest.approx((ordered.heading, ordered.sd_heading))


def test_the_noise_of_the_way_since_a_late_image_counts() -> None:
    def after(sd: float) -> float:
        belief = a_filter(0.0, 0.5)
        belief.update(measured(0.0), turned(-0.4, sd, seconds=-1.0))
        return belief.sd_heading

    assert after(0.0) < after(0.2) < after(2.0) < 0.5


def test_headings_for_a_late_image_are_drawn_from_what_was_believed_then() -> None:
    belief = a_filter(0.3, 0.05, headings=1000)
    for _ in range(4):
        belief.propagate(turned(0.5, 0.3))
    drawn = belief.heading_hypotheses(turned(-1.5, 0.3 * math.sqrt(3.0), seconds=-0.3))
    off = angle_difference(drawn, 0.8)
    assert abs(off.mean()) < 6.0 * 0.31 / math.sqrt(1000)
    assert off.std() == pytest.approx(math.hypot(0.05, 0.3), rel=6.0 / math.sqrt(2000))


def test_a_late_image_does_not_take_the_robot_back_to_where_it_was() -> None:
    belief = a_filter()
    belief.propagate(turned(0.1))
    belief.update(measured(0.1, place=5))
    belief.update(measured(0.0, place=2), turned(-0.1, seconds=-0.1))
    assert belief.state().best_place == 5


def test_memory_of_steps_is_bounded_and_forgets_nothing_that_counts() -> None:
    belief = a_filter(0.0, 0.1)
    for _ in range(3000):
        belief.propagate(turned(0.01, 0.001))
    assert len(belief._steps) <= 1000
    assert belief.sd_heading == pytest.approx(math.sqrt(0.01 + 3000 * 1e-6))
    before = belief.heading
    belief.update(measured(before - 0.01), turned(-0.01, 0.001, seconds=-0.1))
    assert abs(float(angle_difference(belief.heading, before))) < 1e-9


def test_restored_it_goes_on_as_if_nothing_had_happened() -> None:
    one, other = a_filter(0.3, headings=7, seed=3), a_filter(1.0, headings=7, seed=4)
    for belief in (one,):
        for step in range(5):
            belief.propagate(turned(0.2, 0.05))
            belief.heading_hypotheses(None)
            belief.update(measured(0.3 + 0.2 * step))
    other.restore(*one.snapshot())
    for belief in (one, other):
        belief.propagate(turned(0.2, 0.05))
        belief.update(measured(1.2), turned(-0.3, 0.06, seconds=-0.15))
    assert np.array_equal(one.heading_hypotheses(None), other.heading_hypotheses(None))
    assert (one.heading, one.sd_heading) == (other.heading, other.sd_heading)
    assert np.array_equal(one.state().clusters[0].pose, other.state().clusters[0].pose)
