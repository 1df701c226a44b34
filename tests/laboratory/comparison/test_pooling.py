import numpy as np
import pytest

from panoloc_mcl.laboratory.comparison.pooling import differences, groups_of
from panoloc_mcl.laboratory.comparison.summaries.tables import rows_of
from panoloc_mcl.tools.evaluation import bootstrap95


def test_a_bootstrap_interval_is_that_of_the_mean():
    values = np.random.default_rng(1).normal(3.0, 1.0, 200)
    low, high = bootstrap95(values, 0)
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert low == pytest.approx(values.mean() - half, abs=0.02)
    assert high == pytest.approx(values.mean() + half, abs=0.02)
    assert (low, high) == bootstrap95(values, 0)


def test_intervals_hold_the_truth_as_often_as_they_should():
    rng = np.random.default_rng(2)
    hits = 0
    for trial in range(200):
        low, high = bootstrap95(rng.exponential(1.0, 60), trial)
        hits += low <= 1.0 <= high
    assert 0.88 <= hits / 200 <= 0.99


def test_runs_are_paired_by_sequence_and_seed(entry):
    entries = [entry("votes", seed=seed, error_m=0.1) for seed in (0, 1, 2)]
    entries += [entry("paper", seed=seed, error_m=0.3) for seed in (1, 2, 3)]
    rows = [row for one in entries for row in rows_of(one)]
    found = {d.figure: d for d in differences(groups_of(entries), rows, None)}
    position = found["position median"]
    assert (position.method, position.baseline, position.pairs, position.drives) == ("paper", "votes", 2, 1)
    assert position.mean == pytest.approx(200.0, abs=2.0)
    assert position.low <= position.mean <= position.high
    assert found["images to converge"].mean == 0.0


def test_what_does_not_apply_takes_no_part(entry):
    entries = [entry("votes"), entry("paper", converged_from=99)]
    rows = [row for one in entries for row in rows_of(one)]
    figures = {d.figure for d in differences(groups_of(entries), rows, None)}
    assert "position median" not in figures
    assert "success" in figures


def test_groups_are_named_by_what_varies(entry):
    groups = groups_of([entry("votes"), entry("votes", light="evening"), entry("paper"), entry("paper", light="evening")])
    assert [(group.condition, group.method) for group in groups] == [
        ("noon", "votes"),
        ("evening", "votes"),
        ("noon", "paper"),
        ("evening", "paper"),
    ]
    (alone,) = groups_of([entry("votes", seed=0), entry("votes", seed=1)])
    assert (alone.condition, alone.method, alone.metrics["runs"]) == ("noon", "votes", 2)


def test_a_group_whose_cells_all_failed_is_told(entry):
    (group,) = groups_of([entry("votes", failure="no such thing")])
    assert group.metrics is None
    assert group.failures == ("no such thing",)
