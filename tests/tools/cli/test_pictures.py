"""``plot``, ``inspect``, ``--rerun``, ``--json``, and what is said where a library of pictures is missing."""

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from panoloc_mcl.tools.cli.results.plot import FIGURES
from panoloc_mcl.tools.datasets import EMBEDDED
from panoloc_mcl.tools.report import figures
from panoloc_mcl.tools.report.pages.plotly_script import can_plot

needs_matplotlib = pytest.mark.skipif(not figures.can_draw(), reason="matplotlib is not installed")
needs_plotly = pytest.mark.skipif(not can_plot(), reason="plotly is not installed")
ENTITIES = (
    "/map/references",
    "/map/graph/relative_pose",
    "/map/votes",
    "/robot/particles",
    "/robot/estimate",
    "/robot/truth",
    "/camera/panorama",
    "/camera/best_reference",
    "/votes/field",
    "/scalars/n_eff",
    "/scalars/position_error_m",
    "/status",
)


@needs_matplotlib
@pytest.mark.parametrize("figure", FIGURES)
def test_every_figure_can_be_drawn(full_run, panoloc, figure, tmp_path):
    path = tmp_path / f"{figure}.svg"
    done = panoloc("plot", full_run.folder, "--figure", figure, "-o", path)
    assert (done.code, done.err) == (0, "")
    text = path.read_text()
    assert "<svg" in text
    # Units on the axes.
    assert "[m]" in text or "[s]" in text


@needs_matplotlib
@pytest.mark.parametrize(("ending", "start"), [("pdf", b"%PDF"), ("png", b"\x89PNG"), ("svg", b"<?xml")])
def test_figures_are_written_as_their_ending_says_and_the_same_each_time(full_run, panoloc, tmp_path, ending, start):
    one, other = tmp_path / f"a.{ending}", tmp_path / f"b.{ending}"
    for path in (one, other):
        panoloc("plot", full_run.folder, "--figure", "errors", "-o", path, "--sequence", "noon_00")
    assert one.read_bytes().startswith(start)
    assert one.read_bytes() == other.read_bytes()


@needs_matplotlib
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--figure", "errors", "-o", "a.jpg"), "pictures end in .pdf, .png, .svg"),
        (("--figure", "errors", "-o", "/proc/nowhere/a.png"), "cannot be written"),
        (("--figure", "errors", "-o", "a.png", "--sequence", "dusk_00"), "no such sequence; there are afternoon_00"),
        (("--figure", "errors", "-o", "a.png", "--run", "7"), "no such run"),
        (("--figure", "frame", "-o", "a.png", "--frame", "700"), "was not recorded; there are 0 to 19"),
        (("--figure", "error", "-o", "a.png"), "invalid choice: 'error'"),
    ],
)
def test_bad_words_for_a_plot_are_one_line(full_run, panoloc, words, expected):
    done = panoloc("plot", full_run.folder, *words)
    assert done.code == 2
    assert expected in done.err
    assert len(done.err.splitlines()) == 1


def damaged(folder, tmp_path, change):
    copy = Path(shutil.copytree(folder, tmp_path / "copy"))
    change(copy)
    return copy


@needs_matplotlib
@pytest.mark.parametrize("command", [("plot", "--figure", "frame", "-o", "a.png"), ("inspect",), ("evaluate", "--write")])
@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda folder: (folder / "metrics.json").unlink(), "did not finish"),
        (lambda folder: (folder / "metrics.json").write_text('{"schema": "panoloc-metrics/9"}'), "newer"),
        (lambda folder: [path.unlink() for path in folder.glob("*.*")], "did not finish|not a results folder"),
    ],
)
def test_folders_that_are_no_results_are_one_line(full_run, panoloc, tmp_path, command, change, expected):
    import re

    name, *rest = command
    done = panoloc(name, damaged(full_run.folder, tmp_path, change), *rest)
    assert done.code == 2
    assert re.search(expected, done.err)
    assert len(done.err.splitlines()) == 1


@needs_matplotlib
@needs_plotly
@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 no such thing", None])
def test_damaged_frames_are_one_line(full_run, panoloc, tmp_path, damage):
    def change(folder):
        path = folder / "afternoon_00" / "run_0" / "frames.npz"
        path.write_bytes(path.read_bytes()[:9000] if damage is None else damage)

    folder = damaged(full_run.folder, tmp_path, change)
    for words in (("plot", folder, "--figure", "frame", "-o", "a.png"), ("evaluate", folder, "--write")):
        done = panoloc(*words)
        assert done.code == 2
        assert "frames.npz: not recorded frames, or damaged" in done.err
        assert len(done.err.splitlines()) == 1


def test_evaluate_renews_the_player(full_run, panoloc, tmp_path):
    folder = damaged(full_run.folder, tmp_path, lambda path: (path / "report.html").write_text("old"))
    assert panoloc("evaluate", folder, "--write").code == 0
    assert (folder / "report.html").read_text() == (full_run.folder / "report.html").read_text()


def test_evaluate_in_json(full_run, panoloc):
    done = panoloc("evaluate", full_run.folder, "--json")
    assert json.loads(done.out)["metrics"] == json.loads((full_run.folder / "metrics.json").read_text())


@needs_matplotlib
def test_inspect_tells_of_data_map_and_results(small_room, room_map, panoloc, full_run):
    done = panoloc("inspect", small_room, "-o", "data.png")
    assert done.code == 0, done.err
    assert "20, 1.00 m apart" in done.out
    assert "noon_00" in done.out
    no_virtual = ("--set", "observation.votes.virtual_places.enabled=false")
    built = panoloc("build-map", small_room, "-o", "other.panomap", "--json", *no_virtual)
    assert json.loads(built.out)["references"] == 20
    done = panoloc("inspect", room_map, "-o", "map.png")
    assert done.code == 0, done.err
    for what in ("places voted for", "variance kept", "confused"):
        assert what in done.out
    answer = json.loads(panoloc("inspect", room_map, "--json").out)
    assert answer["references"] == 20
    assert 0.0 < answer["variance_kept"] <= 1.0
    assert answer["grey_variance_kept"][-1] == pytest.approx(1.0)
    assert len(answer["confused"]) == 5
    done = panoloc("inspect", full_run.folder, "-o", "results.png")
    assert done.code == 0, done.err
    assert "monte_carlo" in done.out
    for name in ("data", "map", "results"):
        assert Path(f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_inspect_knows_nothing_else(panoloc):
    done = panoloc("inspect", "nowhere")
    assert done.code == 2
    known = ", ".join(EMBEDDED)
    assert done.err == f"nowhere: neither a map file, a data set nor a results folder; check the path, or use {known}\n"


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="rerun is not installed")
def test_the_viewers_own_tools_read_the_file_back(run_small, tmp_path):
    path = tmp_path / "run.rrd"
    assert run_small("--rerun", path).code == 0
    program = Path(sys.executable).with_name("rerun")
    for words in (("rrd", "verify", path), ("rrd", "print", path)):
        done = subprocess.run(
            [program, *words], capture_output=True, text=True, env={"HOME": str(tmp_path), "PATH": "/usr/bin"}
        )
        assert done.returncode == 0, done.stderr
    for entity in ENTITIES:
        assert f" - {entity} - " in done.stdout, entity


@pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="rerun is not installed")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--rerun",), "no display"),
        (("--rerun", "run.bin"), "end in .rrd"),
        (("--rerun", "/proc/nowhere/run.rrd"), "cannot be written"),
    ],
)
def test_what_rerun_cannot_do_is_one_line(run_small, monkeypatch, words, expected):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = run_small(*words)
    assert done.code == 2
    assert expected in done.err
    assert len(done.err.splitlines()) == 1


@pytest.fixture
def bare(monkeypatch):
    """As if none of the libraries of pictures were installed."""
    found = importlib.util.find_spec
    missing = ("matplotlib", "plotly", "rerun", "PIL")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name in missing else found(name, *rest))


def test_a_run_needs_no_library_of_pictures_and_says_what_to_install(bare, run_small, panoloc, full_run):
    done = run_small()
    assert done.code == 0, done.err
    assert 'pip install "panoloc-mcl[report]"' in done.err
    assert 'pip install "panoloc-mcl[report,plot]"' in (done.folder / "report.html").read_text().replace("&#34;", '"')
    for words, extra in (
        (("plot", full_run.folder, "--figure", "errors", "-o", "a.png"), "plot"),
        (("inspect", full_run.folder, "-o", "a.png"), "plot"),
    ):
        done = panoloc(*words)
        assert done.code == 2
        assert f'pip install "panoloc-mcl[{extra}]"' in done.err
    done = run_small("--rerun", "a.rrd")
    assert done.code == 2
    assert 'pip install "panoloc-mcl[rerun]"' in done.err
