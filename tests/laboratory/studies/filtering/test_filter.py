import numpy as np
import pytest

from panoloc_mcl.laboratory.studies.filtering import conditions
from panoloc_mcl.laboratory.studies.filtering.conditions import CONDITIONS, disturbed, noisier
from panoloc_mcl.laboratory.studies.filtering.filter import Remembering
from panoloc_mcl.laboratory.studies.filtering.filter_tables import Trip, tables
from panoloc_mcl.robot.geometry import between
from panoloc_mcl.robot.observation.field import at_headings
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Trajectory, read_image
from panoloc_mcl.tools.evaluation import SequenceRecord
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.streams import Image, Odometry, recorded


@pytest.fixture
def study(ask, small_room):
    """Run it on the first images of the small room; the answer, and its tables by title."""

    def run(*words):
        settings = ("--set", "localizer.monte_carlo.particles=300")
        answer = ask("study", "filter", "--dataset", small_room.path, "--seeds", "2", "--frames", "6", *settings, *words)
        return answer, {table["title"]: table["rows"] for table in answer.report["tables"]} if answer.report else {}

    return run


@pytest.mark.slow
def test_every_condition_has_its_rows(study, small_room):
    conditions = ("plain", "foreign", "drop", "noisy_odometry", "late", "image_only", "kalman", "monte_carlo_90")
    answer, tables = study("--foreign", small_room.path, "--conditions", *conditions)
    assert answer.code == 0
    assert "1 drives, 6 images, each run with 2 seeds" in answer.report["title"]
    assert [row["condition"] for row in tables["Accuracy"]] == list(conditions)
    plain = tables["Finding itself"][0]
    assert (plain["runs"], plain["drives"]) == (2, 1)
    # Two seeds over one drive are one trial.
    assert plain["global success (95 %)"]["trials"] == 2
    assert plain["global success (95 %)"]["interval95"][1] - plain["global success (95 %)"]["interval95"][0] > 0.7
    (paper,) = tables["The Kalman mode beside the paper"]
    assert paper["recognised/passed, paper (95 %)"]["hits"] == 225


@pytest.mark.slow
def test_kidnaps_are_counted(study, monkeypatch):
    monkeypatch.setattr(conditions, "KIDNAP_EVERY", 3)
    answer, tables = study("--conditions", "kidnap")
    assert answer.code == 0
    (row,) = tables["Kidnaps"]
    assert row["kidnaps"] == row["recovered within 10 images (95 %)"]["trials"] > 0
    assert row["drives"] == 1


def test_the_same_command_gives_the_same_table(study):
    words = ("--conditions", "drop", "noisy_odometry")
    (first, tables), (second, _) = study(*words), study(*words)
    assert tables
    # Only the first of all tests builds the map, and says so on standard error.
    assert (first.code, first.report) == (second.code, second.report)


def test_an_image_is_looked_at_once(small_room, own_cache, monkeypatch):
    drive = small_room.select("all")[0]
    panorama_map = cached_map(small_room, RunConfig().observation, 0)
    model = panorama_map.observation_model(RunConfig().observation)
    unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
    panorama = unwrap(read_image(drive.files[0]))
    remembering, looked_at = Remembering(model), []
    observe = model.observe

    def counted(*given):
        looked_at.append(1)
        return observe(*given)

    monkeypatch.setattr(model, "observe", counted)
    asked = np.array([0.3, -2.0])
    assert remembering.observe(panorama) is remembering.observe(panorama)
    given = [remembering.observe(panorama, asked), remembering.observe(panorama, asked + 0.5)][0]
    assert len(looked_at) == 2
    # As the model itself answers.
    np.testing.assert_allclose(given.votes, observe(panorama, asked).votes, atol=1e-5)
    np.testing.assert_array_equal(given.headings, asked)
    circle = remembering.known[next(key for key in remembering.known if not key[1])]
    np.testing.assert_array_equal(given.votes, at_headings(circle.votes, asked))


def test_odometry_gets_as_noisy_as_is_said():
    straight = Trajectory(np.arange(4001.0), np.column_stack([0.1 * np.arange(4001), np.zeros((4001, 2))]))
    noisy = noisier(straight, 3.0, np.random.default_rng(0))
    steps = between(noisy.poses[:-1], noisy.poses[1:])
    assert (steps[:, 0] / 0.1).std() == pytest.approx(np.sqrt(8.0) * conditions.WAY_NOISE, rel=0.1)
    assert abs(steps[:, 2].mean()) == pytest.approx(np.radians(2.0 * conditions.DRIFT_DEG_M) * 0.1, rel=0.1)
    spinning = Trajectory(np.arange(4001.0), np.column_stack([np.zeros((4001, 2)), 0.1 * np.arange(4001)]))
    poses = noisier(spinning, 3.0, np.random.default_rng(0)).poses
    turns = between(poses[:-1], poses[1:])
    assert (turns[:, 2] / 0.1).std() == pytest.approx(np.sqrt(8.0) * conditions.TURN_NOISE, rel=0.1)


def test_late_images_come_in_another_order_with_odometry_ahead(small_room):
    drive, arrival, kept = disturbed(small_room.select("all")[0].of(range(6)), CONDITIONS["late"], 0, ())
    orders, told = [], []
    for message in recorded(drive, arrival, kept):
        if isinstance(message, Odometry):
            told.append(message.timestamp)
        elif isinstance(message, Image):
            orders.append(message.index)
            assert max(told) >= min(drive.times[message.index] + 0.5, drive.odometry.times[-1])
    assert orders == [1, 0, 3, 2, 5, 4]


def test_what_a_status_is_worth():
    """Frames: right and sure; teleported, wrong but sure; lost, still wrong; lost, right again; sure, right."""
    truth = np.array([[0.0, 0.0, 0.0]] + [[5.0, 5.0, 0.0]] * 4)
    poses = truth.copy()
    poses[1:3] = 0.0
    record = SequenceRecord(
        "noon_spliced", 0, np.arange(5.0), poses, truth, ("converged", "converged", "lost", "lost", "converged"),
        np.zeros(5, dtype=np.int64), np.zeros(5), np.arange(5) == 1,
    )  # fmt: skip
    trip = Trip(record, ("noon_00", *["noon_01"] * 4))
    kidnaps, status = tables("", {"kidnap": [trip]}, np.zeros((1, 2))).data()["tables"]
    rates = [round(100.0 * cell["rate"], 1) for cell in status["rows"][0].values() if isinstance(cell, dict)]
    assert rates == [66.7, 66.7, 100.0, 50.0, 50.0]
    # The robot was put into the second drive, and was lost there at once; its pose was right from the third image on.
    row = kidnaps["rows"][0]
    assert (row["drives"], row["kidnaps"], row["noticed within 3 (95 %)"]["hits"]) == (2, 1, 1)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--conditions", "sunshine"), "--conditions sunshine: no such condition"),
        (("--conditions", "foreign"), "give --foreign"),
        (("--seeds", "0"), "0: must be at least 1"),
        (("--set", "localizer.monte_carlo.particles=few"), "particles"),
    ],
)
def test_faults_are_one_line(study, words, said):
    answer, _ = study(*words)
    assert (answer.code, answer.report) == (2, None)
    assert said in answer.err
    assert answer.err.count("\n") == 1
