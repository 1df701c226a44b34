import numpy as np
import pytest

from panoloc_mcl.tools.evaluation.events import find_events, first_lasting

GOOD, MIDDLE, BAD = 0.1, 0.7, 2.0


def errors(*stretches):
    """Errors in metres from pairs of a number of frames and a value."""
    return np.concatenate([np.full(count, value) for count, value in stretches])


def test_first_lasting_needs_ten_seconds_or_the_end():
    times = np.arange(20.0)
    flags = np.zeros(20, dtype=bool)
    flags[2:12] = True  # nine seconds from first to last
    assert first_lasting(flags, times) is None
    flags[12] = True  # ten
    assert first_lasting(flags, times) == 2
    flags[:] = False
    flags[18:] = True
    assert first_lasting(flags, times) is None
    flags[17] = True
    assert first_lasting(flags, times) == 17
    assert first_lasting(np.zeros(0, dtype=bool), np.zeros(0)) is None


def test_no_truth_no_events(make_record):
    assert find_events(make_record("ccc", with_truth=False)) is None


@pytest.mark.parametrize(
    ("status", "metres", "degrees", "succeeded"),
    [
        ("sscccc", GOOD, 0.0, True),  # three seconds, to the end
        ("ssccc", GOOD, 0.0, False),
        ("ssss", GOOD, 0.0, False),
        ("sssc", GOOD, 0.0, False),
        ("cccs", GOOD, 0.0, False),  # neither ten seconds nor the end
        ("c" * 11 + "s", GOOD, 0.0, True),  # ten seconds
        ("c" * 10 + "s", GOOD, 0.0, False),
        ("cccc", 0.5, 0.0, False),  # at the limit is not under it
        ("cccc", 0.499, 0.0, True),
        ("cccc", 0.0, 10.0, False),
        ("cccc", 0.0, -9.99, True),
        ("cccccc", [GOOD, MIDDLE, GOOD, GOOD, GOOD, GOOD], 0.0, True),
        ("cccc", [GOOD, GOOD, MIDDLE, GOOD], 0.0, False),
        ("cccc", [GOOD, GOOD, GOOD, MIDDLE], 0.0, False),
    ],
)
def test_global_success(make_record, status, metres, degrees, succeeded):
    assert find_events(make_record(status, metres, degrees)).succeeded is succeeded


def test_global_success_looks_before_the_first_teleport_only(make_record):
    late = make_record("ssssccccc", kidnapped=[4])
    assert not find_events(late).succeeded
    early = make_record("sccccsssss", errors((5, GOOD), (5, BAD)), kidnapped=[5])
    assert find_events(early).succeeded


@pytest.mark.parametrize(
    ("status", "metres", "degrees", "wrong"),
    [
        ("sccc", BAD, 0.0, True),
        ("ssal", BAD, 0.0, False),
        ("sccc", 1.0, 0.0, False),  # at the limit is not above it
        ("sccc", 1.001, 0.0, True),
        ("sccc", 0.0, 20.0, False),
        ("sccc", 0.0, 20.01, True),
        ("sccc", [GOOD, GOOD, BAD, GOOD], 0.0, True),
    ],
)
def test_false_convergence(make_record, status, metres, degrees, wrong):
    assert find_events(make_record(status, metres, degrees)).falsely_converged is wrong


@pytest.mark.parametrize(
    ("after", "metres", "wrong"),
    [
        ("cccc", BAD, True),
        ("csss", BAD, True),  # the image after the teleport has been seen
        ("ssss", BAD, False),
        ("lccc", errors((1, BAD), (3, GOOD)), False),
        ("cccc", errors((1, BAD), (3, GOOD)), True),
    ],
)
def test_a_teleport_excuses_nothing(make_record, after, metres, wrong):
    record = make_record("cc" + after, np.concatenate([[0, 0], np.broadcast_to(metres, len(after))]), kidnapped=[2])
    assert find_events(record).falsely_converged is wrong


@pytest.mark.parametrize(
    ("metres", "lost"),
    [
        (errors((3, GOOD), (4, BAD), (5, GOOD)), 0),  # three seconds are not more than three
        (errors((3, GOOD), (5, BAD), (5, GOOD)), 1),
        (errors((3, GOOD), (5, 1.0), (5, GOOD)), 0),
        (errors((3, GOOD), (5, BAD), (5, GOOD), (5, BAD), (20, GOOD)), 1),  # not recovered in between
        (errors((3, GOOD), (5, BAD), (11, GOOD), (5, BAD)), 2),
        (errors((3, GOOD), (3, BAD), (1, MIDDLE), (3, BAD)), 0),  # neither stretch is long enough
        (errors((5, BAD), (3, GOOD)), 0),  # not yet localised
    ],
)
def test_tracks_lost(make_record, metres, lost):
    assert find_events(make_record("c" * len(metres), metres)).tracks_lost == lost


def test_lost_by_heading_across_180_degrees(make_record):
    turned = make_record("c" * 10, 0.0, errors((5, 0.0), (5, 185.0)))
    assert find_events(turned).tracks_lost == 1


def test_a_robot_that_never_was_localised_has_no_track_to_lose(make_record):
    assert find_events(make_record("c" * 9, BAD)).tracks_lost is None
    assert find_events(make_record("s" * 9, GOOD)).tracks_lost is None


def test_a_teleport_is_no_lost_track(make_record):
    record = make_record("ccc" + "s" * 8, errors((3, GOOD), (8, BAD)), kidnapped=[3])
    assert find_events(record).tracks_lost == 0


@pytest.mark.parametrize(
    ("metres", "frames"),
    [
        (errors((4, BAD), (11, GOOD), (4, BAD)), 5),  # ten seconds
        (errors((4, BAD), (10, GOOD), (4, BAD)), None),
        (errors((4, BAD), (3, GOOD)), 5),  # to the end
        (errors((4, BAD), (2, GOOD)), None),  # too few frames to tell
        (
            errors(
                (5, GOOD),
            ),
            1,
        ),
        (
            errors(
                (5, 0.5),
            ),
            None,
        ),
    ],
)
def test_recovery_after_a_kidnap(make_record, metres, frames):
    record = make_record("cc" + "s" * len(metres), np.concatenate([[0.0, 0.0], metres]), kidnapped=[2])
    assert find_events(record).frames_to_recover == (frames,)


def test_each_teleport_is_an_event_but_one_too_late_to_judge(make_record):
    record = make_record("c" * 11, errors((3, GOOD), (2, BAD), (3, GOOD), (3, GOOD)), kidnapped=[3, 6, 9])
    # Segments 3-5 (two bad, one good), 6-8 (good), 9-10 (too short).
    assert find_events(record).frames_to_recover == (None, 1)
