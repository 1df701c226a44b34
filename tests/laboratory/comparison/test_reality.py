from dataclasses import replace

import numpy as np
import pytest

from panoloc_mcl.laboratory.comparison.pooling import groups_of
from panoloc_mcl.laboratory.comparison.reality import HEADS, Watched, aligned, has_imperfections, imperfections
from panoloc_mcl.laboratory.comparison.runs import Answers, Runs
from panoloc_mcl.laboratory.comparison.summaries.plots import draw_imperfections
from panoloc_mcl.robot.geometry import compose


def watched(entry, poses=None, sd=0.01, alone=None, **drive):
    """A run with answers of the covariance ``sd``, and with poses and single images as given."""
    (before,) = entry(**drive).result.records
    record = before if poses is None else replace(before, poses=poses(before.truth))
    record = replace(record, covariances=np.tile(np.diag([sd, sd, sd]) ** 2, (len(record), 1, 1)))
    single = record.truth.copy() if alone is None else alone(record.truth)
    return Watched(0, record, Answers(single, np.ones(len(record)), single))


def cells(entry, runs):
    """The row of runs as a mapping from head to cell."""
    whole = replace(entry(), result=Runs(tuple(w.record for w in runs), np.zeros((1, 2)), tuple(w.answers for w in runs)))
    lines = imperfections([whole])
    assert len(lines) == 3
    return dict(zip(HEADS, [cell.strip() for cell in lines[2].strip("|").split("|")], strict=True))


@pytest.mark.parametrize("frame", [(0.3, -0.2, 0.0), (1.0, 2.0, 0.4)])
def test_a_frame_that_lies_elsewhere_is_no_error_when_aligned(entry, frame):
    curved = np.column_stack([np.arange(30) * 0.1, np.sin(np.arange(30) * 0.2), np.zeros(30)])
    base = watched(entry, frames=30)
    record = replace(base.record, truth=curved, poses=compose(np.array(frame), curved))
    metres, degrees = aligned([replace(base, record=record)])
    np.testing.assert_allclose(metres, 0.0, atol=1e-12)
    np.testing.assert_allclose(degrees, 0.0, atol=1e-10)
    # A tenth of the answers being far off does not bend the frame.
    far = record.poses.copy()
    far[::10, :2] += 3.0
    errors, degrees = aligned([replace(base, record=replace(record, poses=far))])
    assert np.sort(errors)[:27].max() < 1e-9
    assert np.sort(errors)[-3:].min() > 2.0
    np.testing.assert_allclose(degrees, 0.0, atol=1e-8)
    # A camera whose heading is off keeps that error: only the frame is free, which positions tell.
    turned = record.poses + np.array([0.0, 0.0, np.radians(2.0)])
    metres, degrees = aligned([replace(base, record=replace(record, poses=turned))])
    np.testing.assert_allclose(metres, 0.0, atol=1e-12)
    np.testing.assert_allclose(degrees, 2.0, atol=1e-8)


def test_each_seed_has_a_frame_of_its_own(entry):
    one = watched(entry, lambda truth: compose(np.array([0.5, 0.0, 0.0]), truth), frames=10)
    other = replace(watched(entry, lambda truth: compose(np.array([-0.5, 0.0, 0.0]), truth), frames=10), seed=1)
    np.testing.assert_allclose(aligned([one, other])[0], 0.0, atol=1e-12)
    assert aligned([one, replace(other, seed=0)])[0].min() > 0.1


def test_single_images_are_judged_by_themselves(entry):
    def alone(truth):
        poses = truth + np.array([0.02, 0.0, 0.0])
        poses[0] = np.nan
        poses[1, 0] += 2.0
        return poses

    row = cells(entry, [watched(entry, alone=alone, frames=10)])
    assert row["one image: right %"] == "80.0"
    assert row["filter: found itself"] == "1/1"


def test_an_answer_that_is_sure_and_wrong_counts_as_an_image_and_as_a_run(entry):
    def wrong_at_first(truth):
        poses = truth.copy()
        poses[:3, 1] += 1.5
        return poses

    runs = [watched(entry, wrong_at_first, frames=10), watched(entry, lambda truth: truth.copy(), light="dusk", frames=10)]
    row = cells(entry, runs)
    assert row["sure and wrong: images %"] == "15.0"
    assert row["runs"] == "1/2"


def test_claims_are_held_against_the_truth(entry):
    rng = np.random.default_rng(0)

    def noisy(truth):
        return truth + np.pad(rng.normal(0.0, 0.02, (len(truth), 2)), ((0, 0), (0, 1)))

    honest = cells(entry, [watched(entry, noisy, sd=0.02, frames=2000)])["NEES, within 2 sd %"].split(", ")
    boastful = cells(entry, [watched(entry, noisy, sd=0.005, frames=2000)])["NEES, within 2 sd %"].split(", ")
    assert float(honest[0]) == pytest.approx(1.0, abs=0.15)
    assert float(honest[1]) == pytest.approx(86.5, abs=3.0)
    assert float(boastful[0]) == pytest.approx(16.0, rel=0.15)
    assert float(boastful[1]) < 30.0


def test_images_without_truth_are_not_judged(entry):
    one = watched(entry, frames=10)
    truth = one.record.truth.copy()
    truth[:5] = np.nan
    wrong = one.record.poses.copy()
    wrong[:5] += 9.0
    row = cells(entry, [replace(one, record=replace(one.record, truth=truth, poses=wrong))])
    assert row["one image: right %"] == "100.0"
    assert row["sure and wrong: images %"] == "0.0"


def test_failures_and_methods_are_named(entry):
    entries = [entry(failure="no map"), entry(method="paper")]
    lines = imperfections(entries)
    assert "failed: no map" in lines[2]
    assert "clean, votes" in lines[2]
    assert "clean, paper" in lines[3]
    assert not has_imperfections(entries)
    assert has_imperfections([entry(corruption="bars:0.5"), entry(corruption="jpeg:mild")])


def test_the_figure_has_a_line_an_imperfection_and_says_what_was_never_sure(entry):
    pytest.importorskip("matplotlib")
    entries = [
        entry(error_m=0.002),
        entry(corruption="jpeg:mild", error_m=0.004),
        entry(corruption="jpeg:strong", error_m=0.02),
        entry(corruption="everything:strong", converged_from=99),
    ]
    figure = draw_imperfections(groups_of(entries))
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["everything", "jpeg"]
    assert [text.get_text() for text in axes.texts] == ["never sure"]
    low, high = axes.collections[0].get_segments()[0][:, 0]
    assert 3.0 < low < high < 9.0
    assert draw_imperfections(groups_of(entries[:1])) is None
