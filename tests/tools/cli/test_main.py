import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import panoloc_mcl
import panoloc_mcl.laboratory.studies.consistency
import panoloc_mcl.tools.runs.pipeline
from panoloc_mcl.robot.errors import PanolocError
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.cli.main import commands

CONFIG = Path(__file__).parents[3] / "configs" / "global.yaml"


def raising(error):
    def run(*_args, **_kwargs):
        raise error

    return run


def test_help_names_every_command(panoloc):
    done = panoloc("--help")
    assert done.code == 0
    for command in commands():
        assert command.name in done.out
        assert command.summary.split()[0] in done.out
        one = panoloc(command.name, "--help")
        assert one.code == 0
        assert "--debug" in one.out


@pytest.mark.parametrize("words", [["--version"], ["run", "--version"]])
def test_version(panoloc, words):
    assert panoloc(*words).out == f"panoloc {panoloc_mcl.__version__}\n"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "panoloc: no command given; see panoloc --help"),
        (["evalute"], "panoloc: unknown command 'evalute'; did you mean 'evaluate'?"),
        (
            ["demo", "kidnp"],
            "panoloc demo: argument demo: invalid choice: 'kidnp' (choose from 'relocalize', 'kidnap'); did you mean 'kidnap'?",
        ),
        (["zzzzz"], "panoloc: unknown command 'zzzzz'; see panoloc --help"),
        (["run"], "panoloc run: the following arguments are required: CONFIG; see panoloc run --help"),
        (["run", "a", "--sed", "1"], "panoloc run: cannot understand '--sed'; did you mean '--seed'?"),
        (["run", "a", "b"], "panoloc run: cannot understand 'b'; see panoloc run --help"),
        (["run", "a", "--seed", "x"], "panoloc run: argument --seed: invalid int value: 'x'; see panoloc run --help"),
        (["build-map", "hall"], "panoloc build-map: the following arguments are required: -o/--output; see panoloc build-map"),
    ],
)
def test_what_cannot_be_understood_is_one_line(panoloc, words, line):
    done = panoloc(*words)
    assert (done.code, done.out) == (2, "")
    (found,) = done.err.splitlines()
    # Whether choices are quoted is Python's version's own.
    assert found.replace("choose from relocalize, kidnap", "choose from 'relocalize', 'kidnap'").startswith(line)


def test_known_errors_are_lines_and_tracebacks_only_when_asked(panoloc, monkeypatch):
    monkeypatch.setattr(panoloc_mcl.tools.runs.pipeline, "run", raising(PanolocError(["a: one\nfault", "b: another"])))
    done = panoloc("run", CONFIG)
    assert (done.code, done.err) == (2, "a: one fault\nb: another\n")
    with pytest.raises(PanolocError):
        panoloc("run", CONFIG, "--debug")


def test_bugs_are_not_hidden(panoloc, monkeypatch):
    monkeypatch.setattr(panoloc_mcl.tools.runs.pipeline, "run", raising(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        panoloc("run", CONFIG)


def test_interrupted_is_quiet(panoloc, monkeypatch):
    monkeypatch.setattr(panoloc_mcl.tools.runs.pipeline, "run", raising(KeyboardInterrupt()))
    done = panoloc("run", CONFIG)
    assert (done.code, done.out, done.err) == (130, "", "")


def test_interrupted_work_that_is_kept_says_so(panoloc, small_room, monkeypatch):
    monkeypatch.setattr(PanoramaMap, "build", raising(KeyboardInterrupt()))
    done = panoloc("build-map", small_room, "-o", "a.panomap")
    assert (done.code, done.err) == (130, "interrupted; the same command, called again, goes on from here\n")

    monkeypatch.setattr(panoloc_mcl.laboratory.studies.consistency, "study", raising(KeyboardInterrupt()))
    done = panoloc("study", "consistency", "--dataset", small_room, "--out", "kept")
    assert (done.code, done.err) == (130, "interrupted; the same command, called again, goes on from here\n")
    assert panoloc("study", "consistency", "--dataset", small_room).err == ""


def test_the_package_is_the_command():
    done = subprocess.run([sys.executable, "-m", "panoloc_mcl", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("panoloc ")


@pytest.mark.slow
def test_a_closed_pipe_is_quiet(tmp_path):
    read_end, write_end = os.pipe()
    os.close(read_end)
    done = subprocess.run(
        [sys.executable, "-m", "panoloc_mcl.tools.cli.main", "check", str(CONFIG)],
        stdout=write_end,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(CONFIG.parents[2])},
    )
    os.close(write_end)
    assert done.returncode == 141
    assert done.stderr == b""


def test_warnings_are_plain_lines_and_the_old_way_comes_back(panoloc, monkeypatch):
    def run(*_args, **_kwargs):
        warnings.warn("the cache\nis full", RuntimeWarning, stacklevel=1)
        raise PanolocError("enough; stop")

    monkeypatch.setattr(panoloc_mcl.tools.runs.pipeline, "run", run)
    before = warnings.showwarning
    assert panoloc("run", CONFIG).err == "warning: the cache is full\nenough; stop\n"
    assert warnings.showwarning is before
