"""Asking a localizer on several maps changes nothing: two calls give one answer, and it goes on as if unasked, whatever happened."""

import json
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.answers import plain
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.floors import FloorLocalizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.datasets import read_dataset, read_image

pytestmark = pytest.mark.slow

FRAMES = 6
# What befalls a robot between two questions, and how often it is asked after it.
happenings = st.tuples(
    st.sampled_from(["ground", "ground", "first", "odometry", "bad image", "set pose", "relocalize", "force"]),
    st.integers(0, FRAMES - 1),
    st.integers(0, 2),
)


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory):
    """Maps of two floors, and the drive and images of each."""
    path, geometry = tmp_path_factory.mktemp("house"), PanoramaGeometry(180, 72, -50.0, 25.0)
    floors = {
        name: read_dataset(build_room(path / name, seed=seed, frames=FRAMES, geometry=geometry, lights=("noon",)))
        for name, seed in (("ground", 7), ("first", 8))
    }
    drives = {name: data.sequences["noon_00"] for name, data in floors.items()}
    images = {name: [read_image(file) for file in drive.files] for name, drive in drives.items()}
    return {name: PanoramaMap.build(data) for name, data in floors.items()}, drives, images


def happen(localizer: FloorLocalizer, house, what: str, index: int, now: float) -> Estimate | None:
    _, drives, images = house
    drive = drives["ground"]
    if what in images:
        localizer.add_odometry(now, drive.odometry.at(min(now, drive.odometry.times[-1])))
        return localizer.add_image(now, images[what][index])
    if what == "odometry":
        localizer.add_odometry(now, drive.odometry.at(min(now, drive.odometry.times[-1])))
    elif what == "bad image":
        return localizer.add_image(now, ImageError("torn"))
    elif what == "set pose":
        localizer.set_pose("first", drives["first"].groundtruth.poses[index])
    elif what == "relocalize":
        localizer.relocalize()
    else:
        localizer.force_update()
    return None


def saved(localizer: FloorLocalizer) -> dict[str, bytes]:
    """Files that it saves where nothing was saved before: beside those of an earlier state they would have other names."""
    with tempfile.TemporaryDirectory() as folder:
        localizer.save_state(Path(folder) / "state")
        return {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir())}


def all_answers(localizer: FloorLocalizer, house, now: float) -> str:
    """Everything public that answers."""
    answers = {
        "map": localizer.map_name,
        "probabilities": localizer.probabilities,
        "poses": [localizer.pose_at(), *(localizer.pose_at(now + later) for later in (-0.3, 0.0, 0.5))],
        "odometry to map": localizer.odometry_to_map(),
        "driven": localizer.driven(now),
        "locate": localizer.locate(house[2]["first"][3]),
        "particles": localizer.particles,
        "has fix": localizer.has_fix,
        "counts": localizer.counts,
        "places": localizer.places.positions,
        "saved": saved(localizer),
    }
    return json.dumps(plain(answers))


@given(history=st.lists(happenings, min_size=1, max_size=6))
@settings(max_examples=5, deadline=None)
def test_asking_twice_gives_one_answer_and_changes_nothing(history: list, house) -> None:
    config = config_from_mapping({"localizer": {"monte_carlo": {"particles": 200}}})
    asked, silent = FloorLocalizer(house[0], config), FloorLocalizer(house[0], config)
    start = float(house[1]["ground"].times[0])
    for number, (what, index, times) in enumerate(history):
        now = start + 0.5 * (number + 1)
        estimates = [happen(localizer, house, what, index, now) for localizer in (asked, silent)]
        assert plain(estimates[0]) == plain(estimates[1])
        assert len({all_answers(asked, house, now) for _ in range(times)}) <= 1
    now = start + 0.5 * (len(history) + 1)
    assert all_answers(asked, house, now) == all_answers(silent, house, now)
