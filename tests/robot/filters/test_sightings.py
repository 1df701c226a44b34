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


def test_it_goes_on_from_what_it_saved():
    sightings = Sightings(LIMITS, 2.0)
    sightings.counted(1.5)
    other = Sightings(LIMITS)
    other.restore(json.loads(json.dumps(sightings.snapshot())))
    for one in (sightings, other):
        one.counted(0.4)
        assert one.judge(Status.CONVERGED, None)[0] is Status.AMBIGUOUS
        one.counted(0.4)
        assert one.judge(Status.CONVERGED, None)[0] is Status.CONVERGED
