"""The study of the map's frame, on a pose graph whose answer is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from panoloc_mcl.laboratory.studies.mapping import frame
from panoloc_mcl.robot.geometry import between
from panoloc_mcl.robot.map.keyframes import Edges, Keyframes

SD = np.array([0.002, 0.002, np.radians(0.03)])


def keyframes(columns: int = 4, rows: int = 3) -> Keyframes:
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    truth = np.column_stack([x.ravel(), y.ravel(), np.zeros(columns * rows)]).astype(float)
    apart = np.hypot(*(truth[:, None, :2] - truth[None, :, :2]).T)
    pairs = np.argwhere((apart < 1.5) & (apart > 0.0))
    measured = between(truth[pairs[:, 0]], truth[pairs[:, 1]])
    edges = Edges.of(pairs, measured, np.broadcast_to(np.diag(SD**2), (len(pairs), 3, 3)))
    surveyed = Keyframes.surveyed(tuple(f"{index}.png" for index in range(len(truth))), truth)
    return replace(surveyed, edges=edges)


def test_what_all_poses_have_in_common_is_the_mean_of_the_errors_that_were_drawn():
    errors, covariances = frame.surveyed(keyframes(), 0.02, 1.0, 8)
    assert errors.shape == (8, 12, 3)
    assert covariances.shape == (8, 12, 3, 3)
    # A frame that turns takes the positions with it, which tell more than twelve headings of 1 degree do.
    turned = np.degrees(np.sqrt(np.mean(errors.mean(axis=1)[:, 2] ** 2)))
    assert 0.05 < turned < 1.0 / np.sqrt(12)
    np.testing.assert_array_equal(errors[:2], frame.surveyed(keyframes(), 0.02, 1.0, 2)[0])


def test_the_command_has_a_row_for_each_kind_of_error(ask, small_room, monkeypatch):
    monkeypatch.setattr(frame, "cached_map", lambda *_, **__: SimpleNamespace(keyframes=keyframes()))
    answer = ask("study", "frame", "--dataset", small_room.path, "--surveys", "4")
    assert answer.code == 0
    rows = answer.rows()
    assert [row["poses off by"] for row in rows] == list(frame.ERRORS)
    small, large = (row["position of a keyframe: error rms, mm"] for row in rows)
    # The same draws, larger.
    assert large == pytest.approx(2.5 * small, rel=0.2)
