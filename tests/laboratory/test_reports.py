import math

import pytest

from panoloc_mcl.laboratory.reports import Number, Rate, Ratio, Report, Spread


def test_a_rate_counts_a_drive_once_however_many_seeds_ran_over_it():
    once = Rate.over((f"noon_{k:02}", True) for k in range(15))
    often = Rate.over((f"noon_{k:02}", True) for k in range(15) for _ in range(20))
    assert once.interval == often.interval
    assert (often.hits, often.trials, often.drives) == (300, 300, 15)
    assert once.text() == "100.0 % (15/15; 79.6 to 100.0)"
    assert Rate.over([]).data()["interval95"] is None


def test_a_spread_stands_infinite_errors():
    spread = Spread([0.1, 0.2, math.inf], 1)
    assert spread.text() == "0.2 / inf / inf"
    assert spread.data() == {"median": 0.2, "p95": math.inf, "max": math.inf}
    assert Spread([]).data() == {"median": None, "p95": None, "max": None}


def test_a_ratio_is_of_the_same_rounds():
    ratio = Ratio.of([2.0, 4.2, 5.8], [1.0, 2.0, 3.0])
    assert ratio.value == pytest.approx(2.0)
    assert ratio.interval[0] < 2.0 < ratio.interval[1]
    assert Ratio.of([3.0], [1.5]).data() == {"ratio": pytest.approx(2.0), "interval95": None, "rounds": 1}


def test_a_report_says_the_same_as_markdown_and_as_data():
    report = Report("What was asked.")
    table = report.table("Answers", ("of", "figure"), note="How they were counted.")
    table.add("a|b", Number(1.234, 2))
    table.add("c", None)
    assert report.markdown().splitlines()[-4:] == ["| of | figure |", "| --- | --- |", "| a\\|b | 1.23 |", "| c | – |"]
    assert report.data()["tables"][0]["rows"] == [{"of": "a|b", "figure": 1.234}, {"of": "c", "figure": None}]
    with pytest.raises(ValueError, match="1 cells for the 2 columns"):
        table.add("too few")
