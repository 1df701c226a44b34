"""Rotations that lay a robot on its side are named instead of read as heading 0."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.datasets import read_tum

HEADINGS = np.linspace(-2.0, 2.0, 30)
# Of a camera that looks ahead: its z axis is the robot's x, its x axis the robot's right.
OPTICAL = Rotation.from_matrix(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))


def written(path, quaternions):
    rows = [f"{t} {0.1 * t} 0 0 " + " ".join(f"{q:.9f}" for q in row) for t, row in enumerate(quaternions)]
    path.write_text("\n".join(rows))
    return path


@pytest.mark.parametrize("tilt_deg", [0.0, 10.0, 35.0])
def test_robots_that_drive_are_read(tilt_deg, tmp_path):
    turns = Rotation.from_euler("ZY", np.column_stack([HEADINGS, np.full(30, np.radians(tilt_deg))]))
    assert read_tum(written(tmp_path / "a.tum", turns.as_quat())).poses[:, 2] == pytest.approx(HEADINGS, abs=1e-6)


@pytest.mark.parametrize(
    ("quaternions", "words"),
    [
        (Rotation.from_euler("z", HEADINGS[:, None]).as_quat()[:, [3, 0, 1, 2]], "w first"),
        (np.tile([1.0, 0.0, 0.0, 0.0], (30, 1)), "w first"),
        ((Rotation.from_euler("z", HEADINGS[:, None]) * OPTICAL).as_quat(), "optical axes"),
        (np.tile(OPTICAL.as_quat(), (30, 1)), "optical axes"),
        ((Rotation.from_euler("z", HEADINGS[:, None]) * Rotation.from_euler("y", 1.4)).as_quat(), "on its side"),
    ],
)
def test_others_are_named(quaternions, words, tmp_path):
    with pytest.raises(DatasetError, match=words) as caught:
        read_tum(written(tmp_path / "a.tum", quaternions))
    assert len(caught.value.faults) == 1
