"""The demos, and their report in a browser."""

import csv
import itertools
import shutil
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.tools.report import figures, read_results
from panoloc_mcl.tools.report.pages import plotly_script

needs_pictures = pytest.mark.skipif(
    not (figures.can_draw() and plotly_script.can_plot()), reason="matplotlib or plotly is not installed"
)
# A closed network, and no screen.
CHROMIUM_FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="module")
def demos(panoloc_process, tmp_path_factory):
    work = tmp_path_factory.mktemp("demos")
    return {name: panoloc_process("demo", name, "--out", work / "results", cwd=work) for name in ("relocalize", "kidnap")}


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is not installed")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=chromium, args=list(CHROMIUM_FLAGS))
        yield opened
        opened.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["relocalize", "kidnap"])
def test_a_demo_succeeds_and_says_where_its_pictures_are(demos, name):
    done = demos[name]
    assert done.code == 0, done.err
    assert (done.folder / "report.html").stat().st_size > 0
    assert "Figures by group" in done.out
    assert "\x1b" not in done.out + done.err


@pytest.mark.slow
def test_the_cloud_collapses_onto_the_true_pose(demos):
    record = read_results(demos["relocalize"].folder).records[0]
    assert record.name.startswith("evening")
    assert record.status[0] == "searching"
    assert record.status[-1] == "converged"
    # While it searches, the pose is the best guess of the image; the cloud is what collapses.
    with next(demos["relocalize"].folder.glob("*/run_0/steps.csv")).open(newline="") as file:
        spreads = [float(row["spread_m"]) for row in csv.DictReader(file)]
    assert spreads[0] > 0.5 > spreads[-1]
    assert record.position_error_m[-1] < 0.5


@pytest.mark.slow
def test_the_robot_gets_lost_and_comes_back(demos):
    record = read_results(demos["kidnap"].folder).records[0]
    away = int(np.flatnonzero(record.kidnapped)[0])
    error = record.position_error_m
    assert error[away - 1] < 0.5
    assert error[away] > 0.5
    assert error[away + 1 :].min() < 0.5
    assert "converged" in record.status[away + 1 :]


@pytest.mark.slow
@needs_pictures
@pytest.mark.parametrize("name", ["relocalize", "kidnap"])
def test_the_moving_picture_moves(demos, name):
    image = pytest.importorskip("PIL.Image")
    with image.open(demos[name].folder / "demo.gif") as gif:
        frames = [gif.seek(number) or np.asarray(gif.convert("RGB"), dtype=np.int16) for number in range(gif.n_frames)]
    assert len(frames) == len(read_results(demos[name].folder).records[0]) + 1
    assert all(np.abs(one - other).max() > 50 for one, other in itertools.pairwise(frames))


@pytest.mark.slow
@needs_pictures
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_the_report_plays_in_a_browser(demos, browser, width, scheme):
    faults = []
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page.on("console", lambda message: faults.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: faults.append(request.url) if request.url.startswith("http") else None)
    report = demos["kidnap"].folder / "report.html"
    assert report.stat().st_size < 15e6
    page.goto(report.as_uri())
    page.wait_for_selector("#map .plot-container")

    def shown():
        return page.evaluate(
            """() => { const traces = document.getElementById("map").data; const of = (name) => traces.find((t) => t.name === name);
            return [document.getElementById("panorama").style.backgroundImage, JSON.stringify(of("particles").x),
                JSON.stringify(of("votes").z), JSON.stringify(document.getElementById("headings").data[0].y),
                JSON.stringify(document.getElementById("status").layout.shapes), document.getElementById("slider").value,
                document.getElementById("caption").textContent]; }"""
        )

    def all_differ(one, other):
        return all(a != b for a, b in zip(one, other, strict=True))

    start = shown()
    page.click("#play")
    page.wait_for_function("document.getElementById('slider').value >= 3")
    page.keyboard.press(" ")
    playing = shown()
    assert all_differ(start, playing)
    page.wait_for_timeout(600)
    assert shown() == playing, "space did not stop it"
    page.fill("#slider", "9")
    moved = shown()
    assert all_differ(playing, moved)
    page.keyboard.press("ArrowRight")
    assert all_differ(moved, shown())
    page.keyboard.press("ArrowLeft")
    assert shown() == moved
    page.keyboard.press("End")
    assert page.input_value("#slider") == page.get_attribute("#slider", "max")
    # Nothing sticks out to the side, and every plot is drawn, with units on its axes.
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    for plot in ("map", "headings", "trajectory", "status", "position-error", "heading-error", "heading", "n-eff", "stages"):
        assert page.evaluate(f"document.getElementById('{plot}').data.length") > 0
        assert "[" in page.evaluate(f"document.getElementById('{plot}').layout.xaxis.title.text")
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert background == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(20, 23, 26)")
    page.close()
    assert faults == []


@pytest.mark.slow
def test_json_is_all_that_is_printed(panoloc, tmp_path, small_room):
    import json

    done = panoloc(
        "demo", "relocalize", "--json", "--out", tmp_path / "out", "--set", f"dataset={small_room}", "--set", "sequences=all"
    )
    assert done.code == 0, done.err
    answer = json.loads(done.out)
    assert (Path(answer["folder"]) / "metrics.json").exists()
    assert answer["metrics"]["overall"]["frames"] == 8
