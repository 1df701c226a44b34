"""Asking a localizer changes nothing, whatever has happened before: two calls give one answer, and it goes on as if unasked."""

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracles.answers import plain

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.datasets import Dataset, read_image

MODES = ("monte_carlo", "kalman_orientation", "odometry_only")
# What befalls a robot between two questions, and how often it is asked after it.
happenings = st.tuples(
    st.sampled_from(["image", "image", "image", "odometry", "late image", "bad image", "set pose", "relocalize", "force"]),
    st.integers(0, 11),
    st.integers(0, 3),
)
histories = st.lists(happenings, min_size=1, max_size=8)


@pytest.fixture(scope="module")
def world(small_room: Dataset, panorama_map: PanoramaMap):
    """The map and its model, and what a drive in it gives."""
    drive = small_room.sequences["noon_00"]
    return panorama_map, drive, [read_image(file) for file in drive.files]


def a_localizer(world, mode: str) -> Localizer:
    panorama_map, drive, _ = world
    limits = {"mode": mode, "initial": "known_pose", "monte_carlo": {"particles": 200}}
    config = config_from_mapping({"localizer": limits})
    start = tuple(drive.groundtruth.poses[0].tolist())
    return Localizer(panorama_map, config, start_pose=start, model=model_of(world))


def model_of(world):
    """One for all: it is not changed by anything."""
    panorama_map = world[0]
    if not hasattr(model_of, "kept"):
        model_of.kept = panorama_map.observation_model(config_from_mapping({}).observation)  # type: ignore[attr-defined]
    return model_of.kept  # type: ignore[attr-defined]  # a function's own attribute


def happen(localizer: Localizer, world, what: str, index: int, now: float) -> Estimate | None:
    _, drive, images = world
    if what == "odometry":
        localizer.add_odometry(now, drive.odometry.at(min(now, drive.odometry.times[-1])))
    elif what == "image":
        localizer.add_odometry(now, drive.odometry.at(min(now, drive.odometry.times[-1])))
        return localizer.add_image(now, images[index])
    elif what == "late image":
        return localizer.add_image(now - 0.4, images[index])
    elif what == "bad image":
        return localizer.add_image(now, ImageError("torn"))
    elif what == "set pose":
        localizer.set_pose(drive.groundtruth.poses[index])
    elif what == "relocalize":
        localizer.relocalize()
    else:
        localizer.force_update()
    return None


def all_answers(localizer: Localizer, world, now: float, folder) -> str:
    """Everything public that answers."""
    image = world[2][3]
    localizer.save_state(folder / "state")
    answers = {
        "pose": localizer.pose_at(),
        "poses": [localizer.pose_at(now + later) for later in (-0.3, 0.0, 0.5)],
        "odometry to map": localizer.odometry_to_map(),
        "driven": localizer.driven(now),
        "locate": localizer.locate(image),
        "particles": localizer.particles,
        "has fix": localizer.has_fix,
        "counts": localizer.counts,
        "mounting tilt": localizer.mounting_tilt,
        "contradictions": localizer.contradictions,
        "skipped": localizer.images_skipped,
        "revision": localizer.map_revision,
        "places": localizer.places.positions,
        "saved": (folder / "state").read_bytes(),
    }
    return json.dumps(plain(answers))


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@given(history=histories)
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_asking_twice_gives_one_answer_and_changes_nothing(mode: str, history: list, world, tmp_path) -> None:
    asked, silent = a_localizer(world, mode), a_localizer(world, mode)
    start = float(world[1].times[0])
    for number, (what, index, times) in enumerate(history):
        now = start + 0.5 * (number + 1)
        estimates = [happen(localizer, world, what, index, now) for localizer in (asked, silent)]
        assert plain(estimates[0]) == plain(estimates[1])
        assert len({all_answers(asked, world, now, tmp_path) for _ in range(times)}) <= 1
        # An answer stays what it was, whatever is asked afterwards.
        assert plain(estimates[0]) == plain(estimates[1])
    now = start + 0.5 * (len(history) + 1)
    assert all_answers(asked, world, now, tmp_path) == all_answers(silent, world, now, tmp_path)


def test_a_model_answers_the_same_twice(world) -> None:
    images = world[2]
    localizer = a_localizer(world, "monte_carlo")
    panorama = localizer.unwrapper(images[2])
    one, other = (model_of(world).observe(panorama) for _ in range(2))
    assert plain(one) == plain(other)
