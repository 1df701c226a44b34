"""The study over the small room, and over a drive of each of the recorded data sets where they are there."""

from pathlib import Path

import pytest

from panoloc_mcl.laboratory.layouts import LAYOUTS

SHARED = Path(__file__).parents[5] / "shared" / "data"


@pytest.mark.slow
def test_poses_and_figures_are_those_of_the_original(ask, small_room) -> None:
    answer = ask("study", "layouts", "--dataset", small_room.path)
    assert answer.code == 0
    rows = {row["layout"]: row for row in answer.rows()}
    assert set(rows) == {"original", *LAYOUTS}
    for name, row in rows.items():
        assert row["images answered"] == len(small_room.sequences["noon_00"])
        if name == "original" or LAYOUTS[name].lossless:
            assert (row["poses"], row["metrics"]) == ("identical", "equal")


@pytest.mark.slow
@pytest.mark.skipif(not (SHARED / "hall_omni").is_dir(), reason="needs ../shared/data")
def test_raw_omnidirectional_images_of_their_own_camera(ask) -> None:
    names = ["ros1", "ros2-mcap-png", "cold", "video"]
    answer = ask(
        "study", "layouts", "--dataset", SHARED / "hall_omni", "--set", "sequences=[noon_00]",
        "--set", "observation.votes.virtual_places.enabled=false", "--layouts", *names,
    )  # fmt: skip
    assert answer.code == 0
    for row in answer.rows():
        assert (row["poses"], row["metrics"]) == ("identical", "equal")
        assert row["images answered"] == 6


def test_what_cannot_be_asked_is_one_line(ask, small_room) -> None:
    answer = ask("study", "layouts", "--dataset", small_room.path, "--layouts", "ros3")
    assert answer.code == 2
    assert "--layouts ros3: no such layout; did you mean 'ros1'?" in answer.err
