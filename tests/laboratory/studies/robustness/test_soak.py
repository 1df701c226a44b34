"""The harness itself, and half a minute of what it does for hours."""

import itertools
import json
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from panoloc_mcl.laboratory.studies.robustness import soak as harness
from panoloc_mcl.laboratory.studies.robustness.soak import IMAGE_FAULTS, Findings, soak, study
from panoloc_mcl.laboratory.studies.robustness.soak import world as driving
from panoloc_mcl.laboratory.studies.robustness.soak.faults import CLOCK, KIDNAP
from panoloc_mcl.laboratory.studies.robustness.soak.remembered import RememberedModel
from panoloc_mcl.laboratory.studies.robustness.soak.world import World
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VoteField
from panoloc_mcl.robot.settings.observation import ObservationSettings
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset, read_image


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["monte_carlo", "kalman_orientation"])
def test_nothing_breaks_in_half_a_minute(mode, small_room: Dataset) -> None:
    found = soak(small_room, RunConfig(seed=3), mode, 300)
    assert found.raised.total() == 0
    assert found.broken.total() == 0
    assert found.updates == 300
    assert len(found.faults) > 10


@pytest.mark.slow
def test_the_paper_s_tracker_is_hardly_ever_sure_and_wrong(small_room: Dataset) -> None:
    """It is carried off every 200 images and does not find back by itself: that it has to know."""
    found = soak(small_room, RunConfig(seed=4), "kalman_orientation", 300)
    assert found.statuses["converged"] > 20
    assert found.wrong <= 3
    assert found.too_long == 0


@pytest.mark.slow
def test_nothing_breaks_where_every_image_is_compared_anew(small_room: Dataset) -> None:
    found = soak(small_room, RunConfig(seed=5), "monte_carlo", 150, anew=True)
    assert found.raised.total() == 0
    assert found.broken.total() == 0
    assert found.updates == 150


@pytest.mark.slow
def test_it_stops_in_time_with_what_was_done(small_room: Dataset) -> None:
    found = soak(small_room, RunConfig(), "kalman_orientation", 10**9, seconds=1.0)
    assert 0 < found.updates < 10**6
    assert min(found.memory_mb) > 0.0
    assert found.seconds < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["monte_carlo", "kalman_orientation"])
def test_what_was_stopped_goes_on(mode, small_room: Dataset, tmp_path) -> None:
    """In another process or in this one: the same world with the same faults, counts that add up, and nothing is done twice."""
    config = RunConfig(seed=3)
    whole = soak(small_room, config, mode, 120)
    parts = [soak(small_room, config, mode, updates, kept=tmp_path) for updates in (50, 50, 120)]
    assert [part.updates for part in parts] == [50, 50, 120]
    assert parts[0].statuses == parts[1].statuses
    assert parts[2].faults == whole.faults
    assert parts[2].statuses.total() == whole.statuses.total()
    assert parts[2].statuses == whole.statuses
    assert parts[2].seconds > parts[0].seconds
    # The state that the counts belong to, and no other.
    assert len(list(tmp_path.iterdir())) == 2
    # Another seed or setting is another soak.
    assert soak(small_room, RunConfig(seed=4), mode, 20, kept=tmp_path).updates == 20
    narrow = RunConfig.model_validate({"seed": 3, "localizer": {"status": {"converged_spread_deg": 5.0}}})
    assert soak(small_room, narrow, mode, 20, kept=tmp_path).updates == 20


@pytest.mark.slow
def test_what_was_kept_and_is_damaged_begins_anew(small_room: Dataset, tmp_path) -> None:
    soak(small_room, RunConfig(), "kalman_orientation", 30, kept=tmp_path)
    (state,) = tmp_path.glob("*.npz")
    state.write_bytes(state.read_bytes()[:100])
    assert soak(small_room, RunConfig(), "kalman_orientation", 10, kept=tmp_path).updates == 10


@pytest.mark.slow
def test_what_is_killed_loses_half_a_minute_at_the_most(small_room: Dataset, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(sys.modules[soak.__module__], "_KEPT_EVERY_S", 0.0)
    look, calls = World.look, itertools.count()

    def killed(self, localizer):
        if next(calls) == 25:
            raise KeyboardInterrupt
        return look(self, localizer)

    monkeypatch.setattr(World, "look", killed)
    with pytest.raises(KeyboardInterrupt):
        soak(small_room, RunConfig(), "kalman_orientation", 40, kept=tmp_path)
    assert soak(small_room, RunConfig(), "kalman_orientation", 10, kept=tmp_path).updates == 25


@pytest.mark.slow
def test_settings_of_the_localizer_count(small_room: Dataset) -> None:
    config = RunConfig.model_validate({"localizer": {"monte_carlo": {"particles": 50}}})
    found = soak(small_room, config, "monte_carlo", 10)
    assert found.broken.total() == 0
    assert found.raised.total() == 0


def test_a_world_that_is_taken_up_again_is_the_same(small_room: Dataset) -> None:
    drives = list(small_room.sequences.values())
    one, other = World(drives, np.random.default_rng(1)), World(drives, np.random.default_rng(2))
    for _ in range(80):
        list(one.step(blind()))
    other.restore(json.loads(json.dumps(one.snapshot())))
    for _ in range(80):
        assert list(one.step(blind())) == list(other.step(blind()))
        np.testing.assert_array_equal(one.pose, other.pose)
        assert len(one._arriving) == len(other._arriving)
        for (stamp, image), (same_stamp, same_image) in zip(one._arriving, other._arriving, strict=True):
            np.testing.assert_equal(stamp, same_stamp)
            assert image.tobytes() == same_image.tobytes()
            if np.isfinite(stamp):
                np.testing.assert_array_equal(one.pose_at(stamp), other.pose_at(stamp))


def blind() -> Localizer:
    """In a localizer's place; takes odometry and does nothing."""
    return cast(Localizer, SimpleNamespace(add_odometry=lambda timestamp, pose: None))


def test_where_the_robot_was_is_told_at_any_time(small_room: Dataset, monkeypatch) -> None:
    """An answer is of the time that it says: after an image that is missing or late, of an earlier one than now."""
    for chance in ("_IN_IMAGE", "_IN_STAMP", "_IN_ODOMETRY"):
        monkeypatch.setattr(driving, chance, 0.0)
    monkeypatch.setattr(driving, "_CARRIED_OFF", 0.1)
    drives = list(small_room.sequences.values())
    world, robot, seen, jumps = World(drives, np.random.default_rng(0)), blind(), [], []
    for _ in range(60):
        faults = set(world.step(robot))
        jumps.append(bool(faults & {KIDNAP, CLOCK}))
        seen.append((world._arriving[0][0], world.pose))
    for stamp, pose in seen[-20:]:
        np.testing.assert_allclose(world.pose_at(stamp), pose, atol=1e-12)
    np.testing.assert_allclose(world.pose_at(np.nan), world.pose)
    assert 0 < sum(jumps[-20:]) < 10
    for (begin, before), (end, after), jump in zip(seen[-20:], seen[-19:], jumps[-19:], strict=False):
        halfway = world.pose_at(0.5 * (begin + end))
        if not jump:
            assert np.hypot(*(halfway - 0.5 * (before + after))[:2]) <= 0.2 * np.hypot(*(after - before)[:2])


@pytest.mark.slow
def test_what_grows_is_the_localizer(small_room: Dataset) -> None:
    """Every image is read and compared before memory is measured."""
    drives = list(small_room.sequences.values())
    world = World(drives, np.random.default_rng(0))
    different = {image.tobytes() for image in world.images()}
    assert 0.5 * world.different < len(different) <= world.different
    for _ in range(300):
        list(world.step(blind()))
        assert all(image.tobytes() in different for _, image in world._arriving)


def test_images_out_of_order_come_after_the_next_one(small_room: Dataset, monkeypatch) -> None:
    """As late as one step: the localizer can take them in."""
    monkeypatch.setattr(driving, "STAMP_FAULTS", ("images reordered",))
    monkeypatch.setattr(driving, "_CARRIED_OFF", 0.0)
    world = World(list(small_room.sequences.values()), np.random.default_rng(2))
    stamps, late = [], 0
    for _ in range(300):
        held = "images reordered" in set(world.step(blind()))
        assert len(world._arriving) == (not held) + bool(late)
        late = held
        stamps += [stamp for stamp, _ in world._arriving]
    back = [after for before, after in itertools.pairwise(stamps) if after < before]
    assert 5 < len(back) < 30
    assert len(set(stamps)) == len(stamps) == 300 - late


@pytest.mark.slow
def test_it_is_told_in_tables(small_room: Dataset) -> None:
    text = study(RunConfig(dataset=str(small_room.path)), updates=20, modes=("monte_carlo",)).markdown()
    assert "sure and wrong" in text
    assert "| monte_carlo | 20 |" in text


@pytest.mark.slow
def test_what_breaks_is_found(small_room: Dataset, monkeypatch) -> None:
    """A localizer that fails, and one that lies: the harness must see both."""
    add_image = Localizer.add_image
    calls = iter(range(10_000))

    def failing(self, timestamp, image):
        estimate = add_image(self, timestamp, image)
        number = next(calls)
        if number == 5:
            raise ZeroDivisionError
        if estimate is None or number < 10:
            return estimate
        return replace(
            estimate, pose=np.add(estimate.pose, (500.0, 0.0, 0.0)), status=Status.CONVERGED, covariance=-np.eye(3), reasons=()
        )

    monkeypatch.setattr(Localizer, "add_image", failing)
    found = soak(small_room, RunConfig(), "monte_carlo", 30)
    assert list(found.raised)
    assert next(iter(found.raised)).startswith("ZeroDivisionError")
    assert "covariance not positive" in found.broken
    # It lies from the tenth image on, twenty times in a row.
    assert found.wrong >= 20
    assert found.too_long >= 20 - harness.MOST_IN_ROW
    assert found.long_runs[0] >= 1
    assert found.long_runs[1] >= 20
    assert found.failed_after.total() >= 20
    assert found.faults_found()


@pytest.mark.slow
def test_what_is_remembered_is_what_the_model_answers(small_room: Dataset, panorama_map: PanoramaMap, monkeypatch) -> None:
    model = panorama_map.observation_model(ObservationSettings())
    asked, observe = [], model.observe

    def counted(panorama: Panorama, headings: NDArray[np.float64] | None = None) -> VoteField:
        asked.append(headings)
        return observe(panorama, headings)

    monkeypatch.setattr(model, "observe", counted)
    remembered = RememberedModel(model)
    drive = next(iter(small_room.sequences.values()))
    unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
    panoramas = [unwrap(read_image(drive.files[number])) for number in (0, 3)]
    panoramas.append(replace(panoramas[0], pixels=np.zeros_like(panoramas[0].pixels)))
    for headings in (None, np.array([0.3]), np.linspace(0.0, 1.0, 7)):
        for panorama in (*panoramas, *panoramas):
            expected, found = observe(panorama, headings), remembered.observe(panorama, headings)
            np.testing.assert_array_equal(found.votes, expected.votes)
            np.testing.assert_array_equal(found.headings, expected.headings)
            assert found.tolerance == expected.tolerance
            assert (found.problem, found.full_circle) == (expected.problem, expected.full_circle)
            np.testing.assert_equal(found.best_at_any_heading, expected.best_at_any_heading)
            if expected.measurement is not None and found.measurement is not None:
                np.testing.assert_array_equal(found.measurement.pose, expected.measurement.pose)
    # Three images anywhere and three with headings; a silent one is asked again, as its rows depend on the headings.
    assert len(asked) == 3 + 3 + 4


@pytest.mark.parametrize("name", list(IMAGE_FAULTS))
def test_faults_change_the_image(name: str) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(1, 255, (36, 90), dtype=np.uint8)
    before = image.copy()
    changed = IMAGE_FAULTS[name](image, rng)
    assert np.array_equal(image, before)
    assert changed.shape != image.shape or not np.array_equal(changed, image)


def test_growing_memory_is_a_fault() -> None:
    assert Findings(memory_mb=(100.0, 104.0)).faults_found() == []
    assert Findings(memory_mb=(100.0, 106.0)).faults_found() == ["memory grew by 6.0 %"]


def test_runs_of_false_answers_are_counted_over_parts() -> None:
    """Those that a stop cut in two are one run."""
    found = Findings()
    found.runs.update({"2": 5, "4": 1, "6": 1})
    found.in_row = 7
    again = Findings.of_data(json.loads(json.dumps(found.data())))
    assert again.lengths == {2: 5, 4: 1, 6: 1, 7: 1}
    assert again.too_long == 1 + 3 + 4
    assert again.long_runs == (3, 7)
    assert again.faults["none"] == 0


def test_memory_of_another_process_is_not_held_against_this_one() -> None:
    before = Findings(memory_mb=(100.0, 106.0))
    after = Findings.of_data(before.data())
    assert after.memory_mb == (0.0, 0.0)
    after.memory_mb = (300.0, 301.0)
    assert after.faults_found() == ["memory grew by 6.0 %"]
