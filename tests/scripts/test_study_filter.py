import re
from dataclasses import replace

import numpy as np
import pytest

from panoloc_mcl.robot.geometry import between
from panoloc_mcl.robot.observation.field import at_headings
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Trajectory
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import Image, Odometry


@pytest.fixture(scope="module")
def script(load_script):
    return load_script("study_filter")


@pytest.fixture
def study(script, small_room, own_cache, capsys):
    """Run it on the first images of the small room; exit code, what it printed, what it complained of."""

    def run(*words):
        settings = ("--set", "localizer.monte_carlo.particles=300")
        code = script.main(["--dataset", str(small_room.path), "--seeds", "2", "--frames", "6", *settings, *words])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def test_every_condition_has_its_rows(study, small_room):
    conditions = ("plain", "foreign", "drop", "noisy_odometry", "late", "image_only", "kalman", "monte_carlo_90")
    code, tables, _ = study("--foreign", str(small_room.path), "--conditions", *conditions)
    assert code == 0
    for name in conditions:
        assert re.search(rf"^\| {name} \| noon \|", tables, re.MULTILINE)
    # Runs of the finding table: two seeds of every sequence.
    runs = 2 * sum(name.startswith("noon") for name in small_room.sequences)
    assert re.search(rf"^\| plain \| noon \| [\d.]+ % \(\d+/{runs}; ", tables, re.MULTILINE)
    assert re.search(r"^\| noon \| 100.0 % \(225/225; 98.3–100.0\) \|", tables, re.MULTILINE)


def test_kidnaps_are_counted(script, study, monkeypatch):
    monkeypatch.setattr(script, "KIDNAP_EVERY", 3)
    code, tables, _ = study("--conditions", "kidnap")
    assert code == 0
    assert re.search(r"^\| noon \| [\d.]+ % \(\d+/[1-9]\d*; ", tables, re.MULTILINE)


def test_the_same_command_gives_the_same_table(study):
    words = ("--conditions", "drop", "noisy_odometry")
    assert study(*words) == study(*words)


def test_an_image_is_looked_at_once(script, small_room, own_cache):
    drive = small_room.select("all")[0]
    panorama_map = cached_map(small_room, RunConfig().observation, 0)
    model = panorama_map.observation_model(RunConfig().observation)
    unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
    panorama = unwrap(script.read_image(drive.files[0]))
    remembering, looked_at = script.Remembering(model), []
    monkey = model.observe
    model.observe = lambda *given: looked_at.append(1) or monkey(*given)
    asked = np.array([0.3, -2.0])
    assert remembering.observe(panorama) is remembering.observe(panorama)
    given = [remembering.observe(panorama, asked), remembering.observe(panorama, asked + 0.5)][0]
    assert len(looked_at) == 2
    # As the model itself answers.
    np.testing.assert_allclose(given.votes, monkey(panorama, asked).votes, atol=1e-5)
    np.testing.assert_array_equal(given.headings, asked)
    circle = remembering.known[next(key for key in remembering.known if not key[1])]
    np.testing.assert_array_equal(given.votes, at_headings(circle.votes, asked))


def test_odometry_gets_as_noisy_as_is_said(script):
    straight = Trajectory(np.arange(4001.0), np.column_stack([0.1 * np.arange(4001), np.zeros((4001, 2))]))
    noisy = script.noisier(straight, 3.0, np.random.default_rng(0))
    steps = between(noisy.poses[:-1], noisy.poses[1:])
    assert (steps[:, 0] / 0.1).std() == pytest.approx(np.sqrt(8.0) * script.WAY_NOISE, rel=0.1)
    assert abs(steps[:, 2].mean()) == pytest.approx(np.radians(2.0 * script.DRIFT_DEG_M) * 0.1, rel=0.1)
    spinning = Trajectory(np.arange(4001.0), np.column_stack([np.zeros((4001, 2)), 0.1 * np.arange(4001)]))
    turns = between(
        *(script.noisier(spinning, 3.0, np.random.default_rng(0)).poses[part] for part in (slice(-1), slice(1, None)))
    )
    assert (turns[:, 2] / 0.1).std() == pytest.approx(np.sqrt(8.0) * script.TURN_NOISE, rel=0.1)


def test_late_images_come_in_another_order_with_odometry_ahead(script, small_room):
    drive = small_room.select("all")[0]
    drive = replace(drive, times=drive.times[:6], files=drive.files[:6])
    told, orders = [], []
    for message in script.delivered(drive, script.CONDITIONS["late"], np.random.default_rng(0), {}):
        if isinstance(message, Odometry):
            told.append(message.timestamp)
        elif isinstance(message, Image):
            orders.append(message.index)
            assert max(told) >= min(message.timestamp + 0.5, drive.odometry.times[-1])
    assert orders == [1, 0, 3, 2, 5, 4]


def test_what_a_status_is_worth(script):
    """Frames: right and sure; teleported, wrong but sure; lost, still wrong; lost, right again; sure, right."""
    truth = np.array([[0.0, 0.0, 0.0]] + [[5.0, 5.0, 0.0]] * 4)
    poses = truth.copy()
    poses[1:3] = 0.0
    record = script.SequenceRecord(
        "noon_00", 0, np.arange(5.0), poses, truth, ("converged", "converged", "lost", "lost", "converged"),
        np.zeros(5, dtype=np.int64), np.zeros(5), np.arange(5) == 1,
    )  # fmt: skip
    row = script._status_table({"kidnap": [record]}).splitlines()[2]
    shares = [cell.split(" %")[0].strip() for cell in row.split("|")[3:-1]]
    assert shares == ["66.7", "66.7", "100.0", "50.0", "50.0"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--conditions", "sunshine"), "--conditions sunshine: no such condition"),
        (("--conditions", "foreign"), "give --foreign"),
        (("--seeds", "0"), "--seeds 0: must be at least 1"),
        (("--set", "localizer.monte_carlo.particles=few"), "particles"),
    ],
)
def test_faults_are_one_line(study, words, said):
    code, out, error = study(*words)
    assert code == 2
    assert out == ""
    assert said in error
    assert error.count("\n") == 1
