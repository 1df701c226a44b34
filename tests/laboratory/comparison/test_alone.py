"""Single images in a comparison: each by itself, failures in the denominator."""

import csv

import numpy as np
import pytest

from panoloc_mcl.laboratory.comparison.alone import report_of_images, rows_of_images
from panoloc_mcl.laboratory.comparison.matrix import matrix_from_mapping
from panoloc_mcl.laboratory.comparison.runs import Answers, Failure, MapCost, Runs, read_runs, write_runs
from panoloc_mcl.laboratory.comparison.study import compare, plan_of_matrix
from panoloc_mcl.laboratory.comparison.summaries.tables import Entry
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.tools.evaluation import SequenceRecord

AXES = {"dataset": "room", "light": "noon", "corruption": "clean"}


def method(name):
    return {"references": "all", "observation": name, "mode": "monte_carlo", "variant": "default"}


def entry(name, off_m, truth_count=None):
    """Images at the origin that are said to lie so far off; NaN: no answer."""
    off = np.asarray(off_m, dtype=float)
    count = len(off)
    poses = np.column_stack([off, np.zeros(count), np.where(np.isnan(off), np.nan, 0.0)])
    record = SequenceRecord(
        name="noon_00",
        run=0,
        times=np.arange(count, dtype=float),
        poses=np.nan_to_num(poses),
        truth=np.zeros((count, 3)),
        status=("searching",) * count,
        best_place=np.full(count, -1),
        step_ms=np.full(count, 250.0),
        kidnapped=np.zeros(count, dtype=bool),
    )
    answers = Answers(poses, np.full(count, np.nan), poses)
    return Entry(AXES, method(name), 0, Runs((record,), np.zeros((1, 2)), (answers,), MapCost(12.0, 3.5)))


def test_an_image_without_an_answer_is_missed_and_never_left_out():
    entries = [entry("sure", [0.002, 0.004, 3.0, np.nan]), entry("weak", [0.1, 0.1, 0.1, np.nan])]
    rows = rows_of_images(entries)
    assert [row["position_m"] for row in rows[:4]] == [0.002, 0.004, 3.0, np.inf]
    short, everything = (table.data()["rows"] for table in report_of_images("Asked.", entries, rows).tables)
    assert short[0]["sure"] == "4.0 / inf; 2/4"
    assert short[0]["weak"] == "**100.0 / inf; 3/4**"
    sure = next(row for row in everything if row["method"] == "sure")
    assert (sure["images"], sure["drives"], sure["wrong answers"]) == (4, 1, 1)
    assert sure["right (95 %)"]["hits"] == 2
    assert sure["right (95 %)"]["trials"] == 4
    assert (sure["s an image"], sure["s a map"], sure["map MB"]) == (0.25, 12.0, 3.5)


def test_a_method_that_fails_is_a_row_with_its_reason():
    entries = [entry("fine", [0.01]), Entry(AXES, method("gone"), 0, Failure("needs pycolmap; install the extra"))]
    text = report_of_images("Asked.", entries, rows_of_images(entries)).markdown()
    assert "needs pycolmap; install the extra" in text
    assert "| failed |" in text


def test_what_a_map_costs_is_kept_with_the_cell(tmp_path):
    runs = entry("sure", [0.1]).result
    write_runs(tmp_path / "cell.npz", "key", {}, runs)
    assert read_runs(tmp_path / "cell.npz", "key").cost == MapCost(12.0, 3.5)


def test_parts_have_axes_of_their_own(data):
    parts = {"lights": {"every": 2}, "noise": {"corruptions": ["noise:5", "clean"], "references": ["fourth"]}}
    plan = plan_of_matrix(matrix_from_mapping({**data, "seeds": 1, "observations": ["votes"], "parts": parts}))
    found = [(cell.condition["corruption"], cell.method["references"], cell.every) for cell in plan.cells]
    assert found == [("clean", "all", 2), ("noise:5", "fourth", 1), ("clean", "fourth", 1)]


def test_faults_in_parts_are_told(data):
    with pytest.raises(ConfigError, match="unknown corruption 'fog'"):
        matrix_from_mapping({**data, "parts": {"mist": {"corruptions": ["fog"]}}})


def test_a_map_of_ones_own_for_one_observation(data):
    given = {"votes": {}, "given": {"model": "votes", "map": {"mend": False}}}
    cells = plan_of_matrix(matrix_from_mapping({**data, "seeds": 1, "observations": given})).cells
    assert [cell.config.map.mend for cell in cells] == [True, False]


@pytest.mark.slow
def test_every_image_is_looked_at_by_itself(plan_of, tmp_path):
    plan = plan_of(
        single_images=True, observations=["orientation_correlation", "template_matching"], seeds=1, frames=9, every=4
    )
    study = compare(plan, tmp_path, plots=False)
    with (study.folder / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    # Of nine frames every fourth, not from the first one on, which is the start of the drive.
    assert [(row["observation"], row["image"]) for row in rows] == [
        (name, str(index)) for name in ("orientation_correlation", "template_matching") for index in range(2)
    ]
    assert all(float(row["position_m"]) < 2.0 for row in rows)
    assert "In short" in study.summary
    assert compare(plan, tmp_path, plots=False).ran == 0
    assert all(part.result.cost.megabytes > 0.0 for part in study.entries)
