"""When a belief is confirmed, and when a map alone cannot tell."""

import json

import numpy as np
import pytest

from panoloc_mcl.robot.filters import Sightings, Status, telling_way
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.settings.localizer import StatusSettings

LIMITS = StatusSettings()
GRID = np.array([(x, y) for x in range(4) for y in range(3)], dtype=float)


@pytest.mark.parametrize(
    ("references", "tells"),
    [
        (GRID, True),
        (GRID[[0, 1, 3]], True),
        (np.add(GRID, [1e4, -1e4]), True),
        (GRID[:1], False),
        (GRID[[0, 5]], False),
        (np.repeat(GRID[[0, 5]], 20, axis=0), False),
        (np.column_stack([np.arange(10.0), np.zeros(10)]), False),
        (np.column_stack([np.arange(10.0), np.arange(10.0)]), False),
        (np.column_stack([np.arange(10.0), 0.05 * np.sin(np.arange(10.0))]), False),
        (0.05 * GRID, False),
    ],
)
def test_which_maps_can_tell(references, tells):
    assert (telling_way(references) == 0.0) == tells


def test_motion_tells_what_the_map_cannot():
    sightings = Sightings(LIMITS, telling_way(GRID[[0, 5]]))
    answers = []
    for _ in range(12):
        sightings.counted(0.3)
        answers.append(sightings.judge(Status.CONVERGED, None))
    statuses = [status for status, _ in answers]
    first = statuses.index(Status.CONVERGED)
    assert first >= 3
    assert statuses == [Status.AMBIGUOUS] * first + [Status.CONVERGED] * (12 - first)
    assert answers[0][1].reason is Reason.MAP_CANNOT_TELL
    assert "drive on" in answers[0][1]
    # Whoever was wrong begins anew.
    sightings.counted(0.3)
    assert sightings.judge(Status.LOST, None)[0] is Status.LOST
    sightings.counted(0.3)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.AMBIGUOUS


def test_images_that_are_not_sure_tell_nothing_a_map_cannot():
    sightings = Sightings(LIMITS, 1.0)
    sightings.counted(0.3, 5.0, vouches=True)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.AMBIGUOUS
    # However far odometry leads from one that was.
    for _ in range(3):
        sightings.counted(2.0, 5.0, vouches=False)
        assert sightings.judge(Status.CONVERGED, None)[0] is Status.AMBIGUOUS
    sightings.counted(0.3, 5.0, vouches=True)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED
    sightings.counted(0.3, 5.0, vouches=False)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED


def test_the_way_to_the_first_sure_image_does_not_count():
    sightings = Sightings(LIMITS, 1.0)
    sightings.counted(5.0)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.AMBIGUOUS
    kept = json.loads(json.dumps(sightings.snapshot()))
    other = Sightings(LIMITS)
    other.restore(kept)
    for one in (sightings, other):
        one.counted(1.1)
        assert one.judge(Status.CONVERGED, None)[0] is Status.CONVERGED


def test_standing_still_tells_nothing():
    sightings = Sightings(LIMITS, 1.0)
    for _ in range(100):
        sightings.counted(0.0)
        assert sightings.judge(Status.CONVERGED, None)[0] is Status.AMBIGUOUS


@pytest.mark.parametrize("status", [Status.SEARCHING, Status.LOST])
def test_a_belief_that_only_grew_wide_is_stale(status):
    sightings = Sightings(LIMITS)
    sightings.counted()
    sightings.judge(Status.CONVERGED, None)
    sightings.left_out(Reason.IMAGE_BLANK)
    assert sightings.judge(status, None)[0] is Status.STALE
    sightings.counted()
    assert sightings.judge(status, None)[0] is status


def sure() -> Sightings:
    """Of a belief that an image has just stood behind."""
    sightings = Sightings(LIMITS)
    sightings.counted()
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED
    return sightings


def test_images_that_do_not_speak_for_the_pose_are_no_evidence_for_it():
    """However narrow the belief is, it is not sure for more than three images in a row that could be of anywhere."""
    sightings, statuses = sure(), []
    # By luck, one is a little better explained here, as among many images of elsewhere some are.
    for backing in (0.3, 2.5, 0.7, 1.2, 0.6):
        sightings.counted(0.3, backing, vouches=False)
        statuses.append(sightings.judge(Status.CONVERGED, None))
    assert [status for status, _ in statuses] == [Status.CONVERGED] * 3 + [Status.STALE] * 2
    assert statuses[-1][1].reason is Reason.NOTHING_COUNTED
    # What the filter knows by itself is as it was.
    assert sightings.judge(Status.LOST, None)[0] is Status.LOST


@pytest.mark.parametrize("what", [{"backing": 1e3, "vouches": False}, {"backing": 0.1, "vouches": True}, {}])
def test_an_image_that_speaks_for_the_pose_counts(what):
    sightings = sure()
    for _ in range(4):
        for _ in range(3):
            sightings.counted(0.3, 0.5, vouches=False)
            assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED
        sightings.counted(0.3, **what)
        assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED


def test_after_too_long_only_an_image_that_is_sure_of_itself_counts():
    sightings = sure()
    for _ in range(LIMITS.stale_images):
        sightings.left_out(Reason.FITS_NOWHERE)
    sightings.counted(0.3, 1e6, vouches=False)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.STALE
    sightings.counted(0.3, 1e6, vouches=True)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED


def test_doubtful_images_speak_for_the_pose_together():
    sightings = sure()
    for _ in range(40):
        sightings.counted(0.3, 4.0, vouches=False)
        assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED


def test_images_without_a_pose_and_those_left_out_are_one_row():
    sightings = sure()
    sightings.left_out(Reason.FITS_NOWHERE)
    sightings.left_out(Reason.FITS_NOWHERE)
    sightings.counted(0.3, 2.0, vouches=False)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED
    sightings.left_out(Reason.STAMP_TWICE)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.STALE


def test_luck_seldom_looks_like_evidence():
    """Where a robot was carried off, likelihoods are 1 on the mean: stale in all but one case in a hundred, and it stays so."""
    rng, sure_again = np.random.default_rng(0), 0
    for _ in range(400):
        sightings, answers = sure(), []
        for backing in rng.lognormal(-0.5, 1.0, 30):
            sightings.counted(0.3, float(backing), vouches=False)
            answers.append(sightings.judge(Status.CONVERGED, None)[0])
        sure_again += Status.CONVERGED in answers[3:]
    assert sure_again <= 400 / LIMITS.counted_odds


def test_odometry_leads_away():
    sightings = Sightings(LIMITS)
    sightings.counted()
    sightings.judge(Status.CONVERGED, None)
    sightings.left_out(Reason.STAMP_TWICE)
    near, far = Motion(np.zeros(3), distance=0.2), Motion(np.zeros(3), distance=0.8)
    assert sightings.judge(Status.CONVERGED, near)[0] is Status.CONVERGED
    status, why = sightings.judge(Status.CONVERGED, far)
    assert status is Status.STALE
    assert why.reason is Reason.POSE_OUTDATED
    assert "loop" in why


def test_it_remembers_what_did_not_speak_for_the_pose():
    sightings, other = sure(), Sightings(LIMITS)
    for _ in range(3):
        sightings.counted(0.3, 0.5, vouches=False)
    other.restore(json.loads(json.dumps(sightings.snapshot())))
    for one in (sightings, other):
        one.counted(0.3, 150.0, vouches=False)
        assert one.judge(Status.CONVERGED, None)[0] is Status.STALE


def test_it_goes_on_from_what_an_older_version_saved():
    sightings = Sightings(LIMITS)
    sightings.restore({"left_out": LIMITS.stale_images - 1, "last": "image_blank", "sure": True})
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.CONVERGED
    sightings.left_out(Reason.IMAGE_BLANK)
    assert sightings.judge(Status.CONVERGED, None)[0] is Status.STALE


def test_it_goes_on_from_what_it_saved():
    sightings = Sightings(LIMITS, 2.0)
    sightings.counted()
    sightings.counted(1.5)
    other = Sightings(LIMITS)
    other.restore(json.loads(json.dumps(sightings.snapshot())))
    for one in (sightings, other):
        one.counted(0.4)
        assert one.judge(Status.CONVERGED, None)[0] is Status.AMBIGUOUS
        one.counted(0.4)
        assert one.judge(Status.CONVERGED, None)[0] is Status.CONVERGED
