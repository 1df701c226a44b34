"""Files of the first formats stay readable: a data set, a map, a saved state and a results folder, as an early version wrote them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl import Localizer, PanoramaMap, StateError, Status, load_config, read_dataset
from panoloc_mcl.robot.camera.mount import Mount
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.datasets import read_image
from panoloc_mcl.tools.report import read_results

FIRST = Path(__file__).parent / "first"
SETTINGS = (
    "localizer.monte_carlo.particles=200",
    "observation.votes.virtual_places.spacing_m=0.5",
    "observation.votes.components=8",
)
CONFIG = Path(__file__).parents[2] / "configs" / "global.yaml"


@pytest.fixture(scope="module")
def drive():
    return read_dataset(FIRST / "dataset").select("all")[0]


@pytest.fixture
def localizer():
    with pytest.warns(UserWarning, match="made by an earlier version"):
        return Localizer(PanoramaMap.load(FIRST / "map.panomap"), load_config(CONFIG, SETTINGS))


def assert_right(estimate, drive, index):
    truth = drive.groundtruth.at(drive.times)[index]
    assert np.hypot(*(estimate.pose - truth)[:2]) < 0.3
    assert abs(angle_difference(estimate.pose[2], truth[2])) < np.radians(5.0)


def test_a_map_localizes(localizer, drive):
    for timestamp, pose in zip(drive.odometry.times, drive.odometry.poses, strict=True):
        localizer.add_odometry(float(timestamp), pose)
    for index, file in enumerate(drive.files):
        estimate = localizer.add_image(drive.times[index], read_image(file))
    assert_right(estimate, drive, -1)


def test_the_pose_of_a_state_is_taken_over(localizer, drive):
    with pytest.raises(StateError, match=r"format is 'panoloc-state/3', this version reads"):
        localizer.load_state(FIRST / "state.npz")
    with pytest.warns(UserWarning, match="only its last pose is taken over"):
        localizer.resume(FIRST / "state.npz")
    estimate = localizer.add_image(drive.times[3], read_image(drive.files[3]))
    assert estimate.status is Status.CONVERGED
    assert_right(estimate, drive, 3)


def test_the_pose_of_a_state_is_that_of_the_camera(localizer, monkeypatch):
    monkeypatch.setattr(localizer, "_mount", Mount(x_m=0.2, yaw_deg=90.0))
    given = []
    monkeypatch.setattr(localizer, "set_pose", lambda pose, _: given.append(pose))
    with pytest.warns(UserWarning, match="only its last pose is taken over"):
        localizer.resume(FIRST / "state.npz")
    with np.load(FIRST / "state.npz") as state:
        weights = np.exp(state["filter.log_weights"])
        mean = weights @ state["filter.poses"][:, :2] / weights.sum()
    # From the base the camera lies 20 cm ahead.
    heading = given[0][2]
    np.testing.assert_allclose(given[0][:2] + 0.2 * np.array([np.cos(heading), np.sin(heading)]), mean, atol=1e-9)


def test_results_are_read_and_counted_again(tmp_path, capsys):
    folder = Path(shutil.copytree(FIRST / "run", tmp_path / "results"))
    results = read_results(folder)
    assert [record.name for record in results.records] == ["noon_00"]
    assert main(["evaluate", str(folder), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert "position_median_m" in json.dumps(again)


@pytest.mark.slow
def test_a_run_is_repeated(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.chdir(shutil.copytree(FIRST, tmp_path / "first"))
    assert main(["run", "run/run.json"]) == 0
    assert "made with other versions" not in capsys.readouterr().out
