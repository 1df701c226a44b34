from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.tools.datasets import Trajectory, read_tum, write_tum

GOOD = "1.0 0 0 0 0 0 0 1"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30)
@given(st.integers(1, 20), st.integers(0, 10_000))
def test_what_is_written_is_read_back(tmp_path: Path, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = 1.7e9 + np.cumsum(rng.uniform(0.01, 2.0, count))
    poses = rng.uniform([-50.0, -50.0, -np.pi], [50.0, 50.0, np.pi], (count, 3))
    write_tum(tmp_path / "t.tum", Trajectory(times, poses))
    back = read_tum(tmp_path / "t.tum")
    assert np.array_equal(back.times, times)
    assert np.allclose(back.poses[:, :2], poses[:, :2], atol=1e-9)
    assert np.abs(angle_difference(back.poses[:, 2], poses[:, 2])).max() < 1e-9


def test_files_have_nine_decimals_and_lie_in_the_plane(tmp_path: Path) -> None:
    write_tum(tmp_path / "t.tum", Trajectory(np.array([1.5]), np.array([[1.0, -2.0, np.pi / 2]])))
    line = (tmp_path / "t.tum").read_text().splitlines()[1]
    assert line.startswith("1.500000000 1.000000000 -2.000000000 0.000000000 ")
    assert [p.name for p in tmp_path.iterdir()] == ["t.tum"]


def test_comments_spaces_and_a_turn_about_the_vertical_are_read(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text("# stamp ...\n\n  1.0   2 3 0  0 0 0.70710678 0.70710678   # here\n2.0 2 3 0 0 0 0 1\n")
    trajectory = read_tum(tmp_path / "t.tum")
    assert len(trajectory) == 2
    assert np.allclose(trajectory.poses[0], [2.0, 3.0, np.pi / 2])
    assert np.allclose(trajectory.at(1.5), [2.0, 3.0, np.pi / 4])


@pytest.mark.parametrize(
    ("lines", "number", "words"),
    [
        ([GOOD, "2.0 nan 0 0 0 0 0 1"], 2, "value nan is not finite"),
        ([GOOD, "2.0 0 0 0 0 0 1"], 2, "7 columns; must be 8"),
        ([GOOD, "2.0 0 zero 0 0 0 0 1"], 2, "'zero' is not a number"),
        ([GOOD, "# x", "1.0 0 0 0 0 0 0 1"], 3, "timestamp 1.0 does not increase"),
        ([GOOD, "0.5 0 0 0 0 0 0 1"], 2, "timestamp 0.5 does not increase"),
        ([GOOD, "2.0 0 0 0 0 0 0.9 0.9"], 2, "quaternion has length 1.27279"),
    ],
)
def test_a_faulty_line_is_named(tmp_path: Path, lines: list[str], number: int, words: str) -> None:
    path = tmp_path / "odometry.tum"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(DatasetError) as caught:
        read_tum(path)
    (fault,) = caught.value.faults
    assert fault.startswith(f"{path}:{number}: {words}")
    assert ";" in fault or ":" in fault.removeprefix(f"{path}:{number}: ")


def test_all_faulty_lines_are_named_up_to_a_limit(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    path.write_text("x\n" * 50)
    with pytest.raises(DatasetError) as caught:
        read_tum(path)
    assert len(caught.value.faults) == 21
    assert "30 more" in caught.value.faults[-1]


@pytest.mark.parametrize(("text", "words"), [(None, "no such file"), ("# nothing\n", "holds no poses")])
def test_missing_and_empty_files(tmp_path: Path, text: str | None, words: str) -> None:
    path = tmp_path / "t.tum"
    if text is not None:
        path.write_text(text)
    with pytest.raises(DatasetError, match=words):
        read_tum(path)


@pytest.mark.parametrize(
    ("times", "poses", "words"),
    [([1.0, 1.0], np.zeros((2, 3)), "does not increase"), ([1.0], np.zeros((2, 3)), r"must be \(n,\)"),
     ([np.nan], np.zeros((1, 3)), "not finite"), ([], np.zeros((0, 3)), "n >= 1")],
)  # fmt: skip
def test_impossible_trajectories_are_refused(times: list[float], poses: np.ndarray, words: str) -> None:
    with pytest.raises(DatasetError, match=words):
        Trajectory(np.array(times), poses)
