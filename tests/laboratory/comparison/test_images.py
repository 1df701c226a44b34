from dataclasses import replace

import numpy as np
import pytest

from panoloc_mcl.laboratory.comparison.images import HEADS, paired_difference95, single_images
from panoloc_mcl.laboratory.comparison.runs import Answers, Runs


def with_answers(entry, observation, off_m, **axes):
    """A cell of one method whose single images are so far off (n,), metres; NaN = says nothing."""
    cell = entry(frames=len(off_m), **axes)
    (record,) = cell.result.records
    guesses = record.truth.copy()
    guesses[:, 0] += off_m
    answers = Answers(guesses, np.ones(len(off_m)), guesses)
    return replace(
        cell, method={**cell.method, "observation": observation}, result=Runs((record,), np.zeros((1, 2)), (answers,))
    )


def rows(lines):
    return [dict(zip(HEADS, [cell.strip() for cell in line.strip("|").split("|")], strict=True)) for line in lines[2:]]


def test_methods_are_paired_image_by_image(entry):
    mine = np.array([0.1] * 8 + [2.0, 0.1])
    theirs = np.array([0.2] * 7 + [np.nan, 0.2, 3.0])
    first, second = rows(single_images([with_answers(entry, "peer", theirs), with_answers(entry, "votes", mine)], "peer"))
    assert first["within 1 m % (95 %)"].startswith("80.0 (")
    assert first["more than the baseline, points (95 %)"] == "–"
    assert second["within 1 m % (95 %)"].startswith("90.0 (")
    assert second["more than the baseline, points (95 %)"].startswith("+10.0 (")
    assert "won 2, lost 1" in second["more than the baseline, points (95 %)"]
    assert second["position mm (95 %): median"].startswith("100.0 (100.0 to")


def test_each_image_counts_once_whatever_the_seeds(entry):
    cells = [with_answers(entry, "votes", np.full(5, 0.1)), replace(with_answers(entry, "votes", np.full(5, 9.0)), seed=1)]
    (row,) = rows(single_images(cells, None))
    assert row["images"] == "5"
    assert row["within 1 m % (95 %)"].startswith("100.0")


def test_nothing_overheard_is_no_table(entry):
    assert single_images([entry()], None) == []


def test_intervals_of_differences_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(0)
    count, shares = 60, [0.8, 0.12, 0.04, 0.04]
    held = []
    for both, won, lost, _ in rng.multinomial(count, shares, 1000):
        low, high = paired_difference95(both + won, won, lost, count)
        held.append(low <= shares[1] - shares[2] <= high)
        # The other way round it is the same with the other sign.
        assert paired_difference95(both + lost, lost, won, count) == pytest.approx((-high, -low))
    assert 0.93 < np.mean(held) < 0.99


def test_no_image_that_differs_still_leaves_a_doubt():
    low, high = paired_difference95(54, 0, 0, 54)
    assert low == pytest.approx(-0.0664, abs=1e-4)
    assert high == pytest.approx(0.0664, abs=1e-4)
