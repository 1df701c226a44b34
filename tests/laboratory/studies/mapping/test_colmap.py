"""The study of COLMAP's maps of drives: how they are judged, and one of them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoloc_mcl.laboratory.studies.mapping import colmap
from panoloc_mcl.laboratory.studies.mapping.colmap import errors_of


def test_a_model_is_as_good_in_any_frame_and_at_any_scale():
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.0, 5.0, (8, 3))
    rotation = Rotation.random(random_state=1).as_matrix()
    centres = {index: 0.3 * rotation @ [x, y, 0.0] + [7.0, -2.0, 1.0] for index, (x, y, _) in enumerate(truth) if index != 3}
    np.testing.assert_allclose(errors_of(centres, truth), np.zeros(7), atol=1e-9)
    centres[5] += 0.3 * rotation @ [0.0, 0.0, 0.1]
    off = errors_of(centres, truth)
    assert np.argmax(off) == 4
    assert 0.03 < off.max() < 0.1


def test_a_drive_without_ground_truth_is_one_line(ask, room):
    (truth,) = room.glob("sequences/*/groundtruth.tum")
    truth.unlink()
    answer = ask("study", "colmap", "--dataset", room)
    assert answer.code == 2
    assert "has no ground truth; models are judged by it" in answer.err


def test_the_largest_model_is_judged_and_none_is_said(ask, small_room, monkeypatch):
    (drive,) = small_room.sequences.values()
    exact = {index: np.array([*pose[:2], 0.0]) for index, pose in enumerate(drive.groundtruth.at(drive.times))}
    monkeypatch.setattr(colmap, "mapped", lambda *_: [exact, {0: np.zeros(3)}])
    (row,) = ask("study", "colmap", "--dataset", small_room.path).rows()
    assert (row["images"], row["images in each model"]) == (12, "12, 1")
    assert row["largest, mm"] == pytest.approx(0.0, abs=1e-6)
    monkeypatch.setattr(colmap, "mapped", lambda *_: [])
    (row,) = ask("study", "colmap", "--dataset", small_room.path).rows()
    assert row["images in each model"] == "none"


@pytest.mark.slow
def test_a_drive_of_small_panoramas(ask, small_room):
    pytest.importorskip("pycolmap", reason="needs the extra 'peers'")
    answer = ask("study", "colmap", "--dataset", small_room.path)
    assert answer.code == 0
    (row,) = answer.rows()
    # Too coarse for a model.
    assert row["images in each model"] == "none"
