"""Two rooms of one shape with other pictures on the walls, as two floors of a house."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.laboratory.studies.floors import ridden
from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.errors import ConfigError, StateError
from panoloc_mcl.robot.files import read_arrays, write_arrays
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.floors import FloorLocalizer, Transition
from panoloc_mcl.robot.interface.keeper import StateKeeper
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image
from panoloc_mcl.tools.streams import answers, recorded

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def floors(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Dataset]:
    path: Path = tmp_path_factory.mktemp("house")
    geometry = PanoramaGeometry(180, 72, -50.0, 25.0)
    return {
        name: read_dataset(build_room(path / name, seed=seed, frames=10, geometry=geometry, lights=("noon",)))
        for name, seed in (("ground", 7), ("first", 8))
    }


@pytest.fixture(scope="module")
def maps(floors: dict[str, Dataset]) -> dict[str, PanoramaMap]:
    return {name: PanoramaMap.build(data) for name, data in floors.items()}


def driven(localizer: FloorLocalizer, data: Dataset) -> Iterator[Estimate]:
    for _, estimate in answers(localizer, recorded(data.sequences["noon_00"])):
        yield estimate


def test_the_floor_is_found_from_nothing(floors, maps) -> None:
    for name, data in floors.items():
        localizer = FloorLocalizer(maps)
        last = list(driven(localizer, data))[-1]
        assert (last.map, last.status, localizer.map_name) == (name, Status.CONVERGED, name)
        assert localizer.probabilities[name] > 0.95
        assert sum(localizer.probabilities.values()) == pytest.approx(1.0)
        truth = data.sequences["noon_00"].groundtruth
        assert truth is not None
        assert np.hypot(*(last.pose - truth.poses[-1])[:2]) < 0.3


def test_it_is_kept_through_rides(floors, maps) -> None:
    for stay in ridden(FloorLocalizer(maps), floors, np.random.default_rng(3), images=8, rides=2):
        assert stay.right[-1]
        assert stay.sure[-1]
        assert not any(sure and other for sure, other in zip(stay.sure, stay.elsewhere, strict=True))


def test_twins_cannot_be_told_and_both_are_named(floors, maps) -> None:
    twins = FloorLocalizer({"here": maps["ground"], "there": maps["ground"]})
    estimates = list(driven(twins, floors["ground"]))
    assert all(estimate.status is not Status.CONVERGED for estimate in estimates)
    assert estimates[-1].status is Status.AMBIGUOUS
    assert Reason.MAP_CANNOT_TELL in estimates[-1].reasons
    assert "here (" in estimates[-1].message
    assert "there (" in estimates[-1].message
    pose = twins.pose_at()
    assert pose is not None
    assert pose.status is not Status.CONVERGED
    twins.set_pose("there", estimates[-1].pose)
    assert twins.probabilities == {"here": 0.0, "there": 1.0}
    twins.relocalize()
    assert twins.probabilities == {"here": 0.5, "there": 0.5}


def test_one_image_tells_the_map_and_the_pose(floors, maps) -> None:
    localizer = FloorLocalizer(maps)
    drive = floors["first"].sequences["noon_00"]
    assert drive.groundtruth is not None
    location = localizer.locate(read_image(drive.files[4]))
    assert location.map == "first"
    assert np.hypot(*(location.pose - drive.groundtruth.poses[4])[:2]) < 0.3
    alike = FloorLocalizer({"here": maps["first"], "there": maps["first"]}).locate(read_image(drive.files[4]))
    assert alike.confidence == pytest.approx(0.5 * Localizer(maps["first"]).locate(read_image(drive.files[4])).confidence)
    assert not localizer.has_fix
    assert localizer.probabilities["first"] == 0.5


def test_a_map_is_replaced_while_it_runs(floors, maps) -> None:
    localizer = FloorLocalizer(maps)
    list(driven(localizer, floors["first"]))
    assert localizer.has_fix
    localizer.force_update()
    localizer.load_map("ground", maps["ground"])
    assert (localizer.map_name, localizer.has_fix) == ("first", True)
    localizer.load_map("first", maps["first"], keep_pose=True)
    assert (localizer.map_name, localizer.has_fix) == ("first", True)
    localizer.load_map("first", maps["first"])
    assert not localizer.has_fix
    assert localizer.probabilities["first"] == 0.5
    with pytest.raises(ConfigError, match="load_map: roof: no such map; known: ground, first"):
        localizer.load_map("roof", maps["ground"])


def test_one_map_is_a_localizer(floors, maps) -> None:
    drive = floors["ground"].sequences["noon_00"]
    alone, plain = FloorLocalizer({"ground": maps["ground"]}), Localizer(maps["ground"])
    for (_, first), (_, second) in zip(answers(alone, recorded(drive)), answers(plain, recorded(drive)), strict=True):
        np.testing.assert_array_equal(first.pose, second.pose)
        assert first.status is second.status
    assert alone.counts == plain.counts


def test_a_saved_state_goes_on(floors, maps, tmp_path: Path) -> None:
    localizer = FloorLocalizer(maps)
    list(driven(localizer, floors["first"]))
    with StateKeeper(localizer, tmp_path / "state.npz"):
        pass
    again = FloorLocalizer(maps)
    with StateKeeper(again, tmp_path / "state.npz") as keeper:
        assert keeper.resumed
        assert again.probabilities == localizer.probabilities
        assert again.map_name == "first"
    with pytest.raises(StateError, match="saved with maps"):
        FloorLocalizer({"other": maps["ground"]}).resume(tmp_path / "state.npz")
    # Saved again, the new files hold, and those before are gone; a robot that is stopped in between has the old ones.
    kept = sorted(file.name for file in tmp_path.iterdir())
    again.save_state(tmp_path / "state.npz")
    assert sorted(file.name for file in tmp_path.iterdir()) != kept
    assert len(kept) == len(list(tmp_path.iterdir())) == 3
    FloorLocalizer(maps).resume(tmp_path / "state.npz")
    # As an earlier version wrote it: one set of files. The next ones take its place.
    header, arrays = read_arrays(tmp_path / "state.npz")
    earlier = {name: value for name, value in header.items() if name != "saved"} | {"format": "panoloc-floors/1"}
    write_arrays(tmp_path / "state.npz", earlier, arrays)
    for number in (0, 1):
        next(tmp_path.glob(f"state.{number}.*")).rename(tmp_path / f"state.{number}.npz")
    later = FloorLocalizer(maps)
    later.resume(tmp_path / "state.npz")
    assert later.probabilities == pytest.approx(localizer.probabilities)
    later.save_state(tmp_path / "state.npz")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["state.0.1.npz", "state.1.1.npz", "state.npz"]
    write_arrays(tmp_path / "other.npz", {**header, "format": "panoloc-floors/9"}, arrays)
    with pytest.raises(StateError, match="format is 'panoloc-floors/9', this version reads"):
        later.resume(tmp_path / "other.npz")
    (tmp_path / "other.npz").unlink()
    whole = (tmp_path / "state.npz").read_bytes()
    next(tmp_path.glob("state.1.*")).write_bytes(b"PK nothing")
    with pytest.raises(StateError, match="not a saved state"):
        again.resume(tmp_path / "state.npz")
    assert set(again.probabilities.values()) == {0.5}
    assert (tmp_path / "state.npz").read_bytes() == whole
    (tmp_path / "state.npz").write_bytes(b"PK nothing")
    with pytest.raises(StateError, match="not a saved state"):
        again.resume(tmp_path / "state.npz")


def test_what_cannot_be_is_one_line(maps) -> None:
    with pytest.raises(ConfigError, match="maps: there is none"):
        FloorLocalizer({})
    with pytest.raises(ConfigError, match="between = roof: no such map; known: ground, first"):
        FloorLocalizer(maps, transitions=[Transition(("ground", "roof"), ((0.0, 0.0), (0.0, 0.0)))])
    with pytest.raises(ConfigError, match="set_pose: roof"):
        FloorLocalizer(maps).set_pose("roof", np.zeros(3))
