"""Frames without truth are not judged: not before it begins, not after it ends, not in its holes."""

from dataclasses import replace

import numpy as np
import pytest

from panoloc_mcl.tools.datasets import Trajectory, read_dataset, truth_at, write_tum
from panoloc_mcl.tools.evaluation import evaluate
from panoloc_mcl.tools.evaluation.events import find_events


def without(record, *rows):
    truth = record.truth.copy()
    truth[list(rows)] = np.nan
    return replace(record, truth=truth)


def test_figures_are_those_of_the_frames_that_have_truth(make_record):
    whole = make_record("sccccccccccc", metres=[5.0] + [0.02] * 5 + [3.0] * 4 + [0.02] * 2)
    known = evaluate([without(whole, 6, 7, 8, 9)], None)["overall"]
    assert known["position_median_m"] == pytest.approx(0.02)
    assert known["position_p95_m"] == pytest.approx(0.02)
    assert known["false_convergence"]["count"] == 0
    assert known["global_success"]["succeeded"] == 1
    assert known["tracks_lost"] == 0
    assert known["frames"] == 12
    assert evaluate([whole], None)["overall"]["false_convergence"]["count"] == 1


def test_a_teleport_in_a_hole_counts_at_its_end(make_record):
    record = without(make_record("c" * 20, metres=0.0, kidnapped=[8]), 7, 8, 9)
    assert np.flatnonzero(record.judged.kidnapped).tolist() == [7]
    assert find_events(record).frames_to_recover == (1,)


def test_a_record_whose_truth_is_all_holes_is_not_judged(make_record):
    record = without(make_record("ccc"), 0, 1, 2)
    assert record.judged is None
    assert find_events(record) is None
    assert evaluate([record], None)["overall"]["ape_rmse_m"] is None


def test_half_known_poses_are_faults(make_record):
    record = make_record("ccc")
    truth = record.truth.copy()
    truth[1, 2] = np.nan
    with pytest.raises(Exception, match="truth, frame 1"):
        replace(record, truth=truth)


@pytest.mark.parametrize("rate", [0.5, 10.0])
def test_where_truth_is_known(rate):
    times = np.arange(0.0, 40.0, 1.0 / rate)
    times = times[(times < 10.0) | (times > 26.0)]
    truth = Trajectory(times, np.zeros((len(times), 3)))
    frames = np.array([-0.5, 0.0, 3.3, 15.0, 25.0, times[-1], times[-1] + 0.5])
    known = np.isfinite(truth_at(truth, frames)).all(axis=1)
    assert known.tolist() == [False, True, True, False, False, True, False]


def test_truth_of_half_a_drive_judges_that_half(make_record, tmp_path, room):
    from panoloc_mcl.tools.config.model import RunConfig
    from panoloc_mcl.tools.report import read_results
    from panoloc_mcl.tools.runs.pipeline import run

    drive = read_dataset(room).sequences["noon_00"]
    truth = drive.groundtruth
    write_tum(drive.path / "groundtruth.tum", Trajectory(truth.times[:2], truth.poses[:2]))
    outcome = run(RunConfig(dataset=str(room), out=tmp_path / "out"))
    (record,) = read_results(outcome.folder).records
    assert record.has_truth.tolist() == [True, True, False]
    assert outcome.metrics["overall"]["frames"] == 3
    again = evaluate([record], read_results(outcome.folder).place_positions)
    assert again["overall"]["ape_rmse_m"] == outcome.metrics["overall"]["ape_rmse_m"]
