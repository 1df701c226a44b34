import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.files import CACHE_VARIABLE
from panoloc_mcl.tools.cli.main import main

CONFIGS = Path(__file__).parents[3] / "configs"
# Of the small room: a map of it takes a few seconds.
SIZE = PanoramaGeometry(90, 36, -50.0, 25.0)


@dataclass(frozen=True)
class Done:
    """What a command left behind."""

    code: int | str | None
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
    """A cache of the tests' own, in which a map is built once for all of them."""
    return tmp_path_factory.mktemp("cache")


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
            code: int | str | None = main([str(word) for word in words])
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
            [sys.executable, "-m", "panoloc_mcl.tools.cli.main", *map(str, words)],
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
def _small_room(tmp_path_factory):
    """The room in small panoramas: twenty references, enough for the paper's eigenimages, and one drive of eight frames."""
    return build_room(tmp_path_factory.mktemp("small") / "room", frames=8, geometry=SIZE, lights=("noon",))


@pytest.fixture
def small_room(_small_room, tmp_path):
    """A copy of it that a test may damage."""
    return Path(shutil.copytree(_small_room, tmp_path / "room"))


@pytest.fixture(scope="session")
def built(_small_room, panoloc_process, tmp_path_factory):
    """``build-map`` over the small room; its map is not to be changed."""
    work = tmp_path_factory.mktemp("built")
    return panoloc_process("build-map", _small_room, "-o", work / "room.panomap", cwd=work)


@pytest.fixture
def room_map(built, tmp_path):
    """A copy of the small room's map that a test may damage."""
    return Path(shutil.copy(built.folder, tmp_path / "room.panomap"))


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
