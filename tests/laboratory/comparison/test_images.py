from dataclasses import replace

import numpy as np

from panoloc_mcl.laboratory.comparison.images import HEADS, single_images
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
    assert second["more than the baseline, points (95 %)"] == "+10.0 (won 2, lost 1)"
    assert second["position mm (95 %): median"] == "100.0"


def test_each_image_counts_once_whatever_the_seeds(entry):
    cells = [with_answers(entry, "votes", np.full(5, 0.1)), replace(with_answers(entry, "votes", np.full(5, 9.0)), seed=1)]
    (row,) = rows(single_images(cells, None))
    assert row["images, drives"] == "5, 1"
    assert row["within 1 m % (95 %)"].startswith("100.0")


def test_nothing_overheard_is_no_table(entry):
    assert single_images([entry()], None) == []


def test_a_drive_of_many_images_is_one_drive(entry):
    few = rows(single_images([with_answers(entry, "votes", np.full(5, 0.1), light=light) for light in "abcde"], None))[0]
    many = rows(single_images([with_answers(entry, "votes", np.full(50, 0.1), light=light) for light in "abcde"], None))[0]
    assert few["within 1 m % (95 %)"] == many["within 1 m % (95 %)"] == "100.0 (56.6–100.0)"
    assert few["position mm (95 %): median"] == "100.0 (100.0 to 100.0)"


def test_one_drive_tells_a_median_and_no_interval(entry):
    mine, theirs = (with_answers(entry, name, np.full(9, off)) for name, off in (("votes", 0.1), ("peer", 2.0)))
    _, row = rows(single_images([theirs, mine], "peer"))
    assert row["position mm (95 %): median"] == "100.0"
    assert row["more than the baseline, points (95 %)"] == "+100.0 (won 9, lost 0)"
