import dataclasses

import numpy as np
import pytest

from panoloc_mcl.robot.errors import ResultsError


def test_errors_are_distances_and_turns_without_sign(make_record):
    record = make_record("cc", metres=[-0.3, 0.4], degrees=[-5.0, 2.0])
    assert record.position_error_m == pytest.approx([0.3, 0.4])
    assert record.heading_error_deg == pytest.approx([5.0, 2.0])


def test_heading_error_takes_the_short_way_across_180_degrees(make_record):
    record = make_record("ccc")
    theta = np.radians([[179.0, -179.0], [-170.0, 170.0], [180.0, 0.0]])
    poses, truth = record.poses.copy(), record.truth.copy()
    poses[:, 2], truth[:, 2] = theta.T
    turned = dataclasses.replace(record, poses=poses, truth=truth)
    assert turned.heading_error_deg == pytest.approx([2.0, 20.0, 180.0])


def test_without_truth_there_are_no_errors(make_record):
    record = make_record("cc", with_truth=False)
    assert record.position_error_m is None
    assert record.heading_error_deg is None


@pytest.mark.parametrize(
    ("name", "group"), [("noon_00", "noon"), ("late_noon_3", "late_noon"), ("noon", "noon"), ("_7", "_7"), ("a_", "a")]
)
def test_group_is_the_name_up_to_the_last_underscore(make_record, name, group):
    assert make_record("c", name=name).group == group


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"times": [1.0, 1.0, 2.0]}, "times, frame 1: 1.0 does not follow 1.0; stamps must increase"),
        ({"times": [1.0, np.nan, 2.0]}, "times, frame 1: nan is not finite"),
        ({"times": []}, "holds no frame"),
        ({"times": [[1.0]]}, r"times has shape \(1, 1\)"),
        ({"poses": np.zeros((2, 3))}, r"poses has shape \(2, 3\) for 3 frames; give \(3, 3\)"),
        ({"poses": np.full((3, 3), np.inf)}, "poses, frame 0"),
        ({"truth": np.zeros((3, 2))}, "truth has shape"),
        ({"status": ("converged",)}, "status has 1 entries for 3 frames"),
        ({"status": ("converged", "found", "lost")}, "status, frame 1: 'found'; use one of searching, converged"),
        ({"best_place": [0, -2, 0]}, "best_place, frame 1: -2; use -1 for none"),
        ({"step_ms": [1.0, 1.0, -1.0]}, "step_ms, frame 2: -1.0"),
        ({"kidnapped": [True, False, False]}, "kidnapped, frame 0"),
        ({"run": -1}, "run = -1; count runs from 0"),
        ({"name": ""}, "the name is empty"),
    ],
)
def test_faults_are_named(make_record, change, fault):
    with pytest.raises(ResultsError, match=fault):
        dataclasses.replace(make_record("ccc"), **change)


def test_all_faults_at_once(make_record):
    with pytest.raises(ResultsError) as caught:
        dataclasses.replace(make_record("ccc"), best_place=[-5, 0, 0], step_ms=[-1.0, 0.0, 0.0])
    assert len(caught.value.faults) == 2
