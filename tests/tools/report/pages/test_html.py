import importlib.util
import re
import xml.etree.ElementTree as ET

import pytest

from panoloc_mcl.tools.evaluation import evaluate
from panoloc_mcl.tools.report import figures, render_report
from panoloc_mcl.tools.report.figures.style import INK
from panoloc_mcl.tools.report.selection import pictured

needs_matplotlib = pytest.mark.skipif(importlib.util.find_spec("matplotlib") is None, reason="matplotlib is not installed")


def render(records, run_info, places):
    return render_report(evaluate(records, places), run_info, records, places)


@needs_matplotlib
def test_pictures_are_embedded_and_nothing_is_fetched(make_record, run_info, places):
    text = render([make_record(), make_record(run=1), make_record("evening_00", with_truth=False)], run_info, places)
    assert text.count("<svg ") == 3
    assert "2 of 3 runs are pictured" in text
    assert "evening_00, run 0" in text
    # Names of XML dialects look like addresses but are never fetched.
    assert not re.search(r'(src|@import|url\()\s*=?\s*["\']?https?:', text)
    assert "<script" not in text
    assert "prefers-color-scheme: dark" in text


@needs_matplotlib
def test_names_within_the_pictures_do_not_clash(make_record, run_info, places):
    text = render([make_record(), make_record("noon_01")], run_info, places)
    names = re.findall(r'\bid="([^"]+)"', text)
    assert names
    assert len(names) == len(set(names))
    assert set(re.findall(r"url\(#([^)]+)\)", text)) <= set(names)
    assert set(re.findall(r'href="#([^"]+)"', text)) <= set(names)


@needs_matplotlib
def test_the_report_is_the_same_each_time(make_record, run_info, places):
    assert render([make_record()], run_info, places) == render([make_record()], run_info, places)


@needs_matplotlib
@pytest.mark.parametrize("with_truth", [True, False])
@pytest.mark.parametrize("status", ["searching", "converged"])
@pytest.mark.parametrize("kidnapped_at", [None, 12])
def test_pictures_are_whole_svg(make_record, places, with_truth, status, kidnapped_at):
    record = make_record(with_truth=with_truth, kidnapped_at=kidnapped_at)
    object.__setattr__(record, "status", (status,) * len(record))
    for svg in (figures.trajectory_svg(record, places), figures.trajectory_svg(record, places[:0]), figures.errors_svg(record)):
        if svg is None:
            assert not with_truth
            continue
        root = ET.fromstring(svg)
        assert root.get("viewBox")
        assert root.get("width") is None
        assert "noon_00, run 0" in root.get("aria-label", "")
        assert "currentColor" in svg
        assert INK not in svg


@needs_matplotlib
def test_one_frame_many_frames_and_many_places_can_be_drawn(make_record, places):
    figures.errors_svg(make_record(n=2))
    figures.trajectory_svg(make_record(n=2), places)
    errors = figures.errors_svg(make_record(n=20000))
    assert errors is not None
    assert len(errors) < 300_000
    many = places[[0] * 2000] + [[0.001 * i, 0.002 * i] for i in range(2000)]
    assert len(figures.trajectory_svg(make_record(), many)) < 150_000


def test_without_the_plotting_library_the_report_says_how_to_get_pictures(make_record, run_info, places, monkeypatch):
    monkeypatch.setattr(figures, "can_draw", lambda: False)
    text = render([make_record()], run_info, places)
    assert "<svg" not in text
    assert 'pip install "panoloc-mcl[report,plot]"' in text


def test_names_are_escaped_and_blanks_shown(make_record, places, monkeypatch):
    monkeypatch.setattr(figures, "can_draw", lambda: False)
    records = [make_record("<b>_0", with_truth=False), make_record("c_0")]
    text = render(records, {"name": "<script>alert(1)</script>"}, places)
    assert "<script" not in text
    assert "<b>" not in text
    assert "&lt;b&gt;" in text
    assert "None" not in text
    assert "<td>–</td>" in text


def test_groups_take_turns_when_there_are_many_sequences(make_record):
    records = [make_record(f"{group}_{i}", run=r, n=3) for group in ("a", "b", "c") for i in range(4) for r in range(2)]
    chosen = pictured(records, 5)
    assert [(record.name, record.run) for record in chosen] == [("a_0", 0), ("a_1", 0), ("b_0", 0), ("b_1", 0), ("c_0", 0)]
    assert len(pictured(records, 50)) == 12
