"""The study of where a camera sits: its bound, and its command."""

import numpy as np

from panoloc_mcl.laboratory.studies.cameras.mount import Stretch, bound, placed
from panoloc_mcl.tools.datasets import Trajectory

TIMES = np.linspace(0.0, 10.0, 21)


def stretch(turn_deg: float) -> Stretch:
    """Half a metre a second, bending to either side in turn."""
    heading = np.radians(turn_deg) * np.sin(TIMES)
    step = 0.25 * np.column_stack([np.cos(heading), np.sin(heading)])
    position = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (step[1:] + step[:-1]), axis=0)])
    drive = Trajectory(TIMES, np.column_stack([position, heading]))
    return Stretch(TIMES, drive, drive)


def test_turns_tell_where_the_camera_sits_and_a_straight_way_does_not():
    assert stretch(0.0).turns_deg == 0.0
    straight, bent, winding = (bound(stretch(degrees)) for degrees in (0.0, 20.0, 60.0))
    assert (straight > 10.0).all()
    assert (winding < bent).all()
    assert (bent < 0.05).all()


def test_a_winding_drive_is_placed_about_as_well_as_it_can_be():
    rng, winding = np.random.default_rng(0), stretch(60.0)
    errors = np.array([placed(winding, rng)[:2] for _ in range(10)])
    # Its wheels do not err at all, and images by what the bound takes.
    assert (np.sqrt(np.mean(errors**2, axis=0)) < 3.0 * bound(winding)).all()


def test_the_command_holds_errors_against_the_bound(ask, small_room):
    answer = ask("study", "mount", "--dataset", small_room.path, "--metres", "4")
    assert answer.code == 0
    assert [row["mm"] for row in answer.rows()] == ["least standard deviation", "claimed standard deviation", "error"]
    assert [row["error"] for row in answer.rows(1)] == ["ahead", "aside"]


def test_stretches_of_too_few_images_are_one_line(ask, room):
    answer = ask("study", "mount", "--dataset", room)
    assert answer.code == 2
    assert "no drive has ground truth, odometry and 8 images within 5 m" in answer.err
