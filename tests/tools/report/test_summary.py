import pytest

from panoloc_mcl.tools.evaluation import evaluate
from panoloc_mcl.tools.report import render_summary


def test_tells_what_was_run_and_how_well(make_record, run_info, places):
    text = render_summary(evaluate([make_record(), make_record("evening_00")], places), run_info)
    assert text.startswith("# hall \\| global\n\n* data set: hall\n* mode: monte\\_carlo\n")
    assert "* seed: 0\n" in text
    assert "| figure | unit | evening | noon | overall |\n| :--- | :--- | ---: | ---: | ---: |\n" in text
    assert "161/193" not in text
    assert "## Definitions" in text
    assert "\n\n\n" not in text


@pytest.mark.parametrize(
    ("mode", "away", "shown"), [("kalman_orientation", 0, True), ("kalman_orientation", 10, False), ("monte_carlo", 0, False)]
)
def test_the_paper_stands_beside_what_is_like_it(make_record, run_info, places, mode, away, shown):
    metrics = evaluate([make_record("evening_00")], places)
    text = render_summary(metrics, {**run_info, "mode": mode, "kidnap_every_frames": away})
    assert ("| recognised/passed |  | 161/193 |" in text) is shown


def test_tables_have_the_same_number_of_cells_in_every_row(make_record, places):
    records = [make_record("a|b_0"), make_record("c_0")]
    text = render_summary(evaluate(records, places), {})
    rows = [line.replace("\\|", "") for line in text.splitlines() if line.startswith("|")]
    assert {row.count("|") for row in rows} == {6}


def test_figures_that_do_not_apply_are_blank(make_record, places):
    records = [make_record(with_truth=False), make_record("evening_00")]
    text = render_summary(evaluate(records, places), {})
    assert text.startswith("# Localization run\n")
    assert "None" not in text
    assert "nan" not in text
    assert "| – |" in text
    assert "None" not in render_summary(evaluate(records[:1], places), {})
