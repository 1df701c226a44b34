import io

import pytest
from rich.console import Console

from panoloc_mcl.tools.evaluation import evaluate
from panoloc_mcl.tools.report import print_metrics


def printed(metrics, width, encoding="utf-8"):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    print_metrics(metrics, Console(file=stream, width=width))
    stream.flush()
    return raw.getvalue().decode(encoding)


@pytest.fixture
def metrics(make_record, places):
    lights = ("noon", "afternoon", "evening", "night")
    return evaluate([make_record(f"{light}_00", kidnapped_at=12, n=200) for light in lights], places)


@pytest.mark.parametrize("width", [60, 80, 200])
def test_fits_the_terminal_and_shows_every_column(metrics, width):
    text = printed(metrics, width)
    assert all(len(line) <= width for line in text.splitlines())
    for word in ("noon", "afternoon", "evening", "night", "overall", "position, median [m]", "paper"):
        assert word in text
    assert "…" not in text
    for group in metrics["groups"].values():
        assert f"{group['position_median_m']:.4f}" in text


def test_is_plain_text_when_not_a_terminal(metrics):
    assert "\x1b" not in printed(metrics, 80)


def test_columns_that_fit_stay_side_by_side(metrics):
    assert printed(metrics, 200).count("Accuracy after convergence") == 1
    assert printed(metrics, 60).count("Accuracy after convergence") > 1


def test_a_file_or_a_pipe_has_no_width_unless_one_is_named(metrics, capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    print_metrics(metrics)
    unbounded = capsys.readouterr().out
    assert unbounded.count("Accuracy after convergence") == 1
    assert max(map(len, unbounded.splitlines())) < 200
    monkeypatch.setenv("COLUMNS", "60")
    print_metrics(metrics)
    assert all(len(line) <= 60 for line in capsys.readouterr().out.splitlines())


def test_where_only_ascii_can_be_shown(metrics):
    text = printed(metrics, 80, encoding="ascii")
    assert "heading, median [deg]" in text
    assert "?" not in text


def test_figures_that_do_not_apply(make_record, places):
    text = printed(evaluate([make_record(with_truth=False), make_record("evening_00")], places), 80)
    assert "None" not in text
    assert "–" in text
