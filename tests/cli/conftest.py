import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from panoloc_mcl.cli.main import main
from panoloc_mcl.datasets import embedded_dataset
from panoloc_mcl.files import CACHE_VARIABLE

CONFIGS = Path(__file__).parents[2] / "configs"


@dataclass(frozen=True)
class Done:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def lines(self):
        return self.out.splitlines()

    @property
    def folder(self):
        """The path that is printed last."""
        return Path(self.lines[-1])


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """A cache of the tests' own, with the embedded data set rendered once."""
    path = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(path))
        embedded_dataset("room")
    return path


@pytest.fixture(autouse=True)
def _elsewhere(cache, tmp_path, monkeypatch):
    """Commands run in a folder of their own and never touch the user's cache."""
    monkeypatch.setenv(CACHE_VARIABLE, str(cache))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")


@pytest.fixture
def panoloc(capsys):
    """Run a command in this process."""

    def call(*words):
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:
            code = end.code
        return Done(code, *capsys.readouterr())

    return call


@pytest.fixture(scope="session")
def panoloc_process(cache):
    """Run a command in a process of its own."""

    def call(*words, cwd, **environment):
        import os

        done = subprocess.run(
            [sys.executable, "-m", "panoloc_mcl.cli.main", *map(str, words)],
            capture_output=True,
            text=True,
            cwd=cwd,
            env={**os.environ, CACHE_VARIABLE: str(cache), "PYTHONPATH": str(CONFIGS.parent), **environment},
        )
        return Done(done.returncode, done.stdout, done.stderr)

    return call


@pytest.fixture(scope="session")
def full_run(panoloc_process, tmp_path_factory):
    """The main job: global localization over the whole embedded data set."""
    work = tmp_path_factory.mktemp("run")
    return panoloc_process("run", CONFIGS / "global.yaml", "--out", work / "results", cwd=work)


@pytest.fixture(scope="session")
def _small_room(cache, tmp_path_factory):
    """The room with one drive of eight frames."""
    path = tmp_path_factory.mktemp("small") / "room"
    source = next(cache.glob("room-*"))
    shutil.copytree(source, path, ignore=shutil.ignore_patterns("afternoon_*", "evening_*"))
    frames = path / "sequences" / "noon_00" / "frames.csv"
    frames.write_text("".join(frames.read_text().splitlines(keepends=True)[:9]))
    return path


@pytest.fixture
def small_room(_small_room, tmp_path):
    """A copy of it that a test may damage."""
    return Path(shutil.copytree(_small_room, tmp_path / "room"))


@pytest.fixture
def drive(small_room):
    """Its drive."""
    return small_room / "sequences" / "noon_00"


@pytest.fixture
def run_small(panoloc, small_room, tmp_path):
    """Localize over the small room."""

    def call(*words, config="global"):
        return panoloc("run", CONFIGS / f"{config}.yaml", "--set", f"dataset={small_room}", "--out", tmp_path / "out", *words)

    return call
