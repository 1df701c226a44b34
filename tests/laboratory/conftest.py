import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from panoloc_mcl.robot.files import CACHE_VARIABLE
from panoloc_mcl.tools.cli.main import main


@dataclass(frozen=True)
class Answer:
    """What a command that gives a report answered."""

    code: int | str | None
    report: dict[str, Any] | None
    err: str

    def rows(self, table: int = 0) -> list[dict[str, Any]]:
        return self.report["tables"][table]["rows"]


@pytest.fixture(scope="session")
def laboratory_cache(tmp_path_factory):
    return tmp_path_factory.mktemp("laboratory_cache")


@pytest.fixture
def own_cache(laboratory_cache, monkeypatch):
    """Maps of the tests are kept apart from the user's."""
    monkeypatch.setenv(CACHE_VARIABLE, str(laboratory_cache))


@pytest.fixture
def ask(own_cache, capsys):
    """Run a command with --json in this process."""

    def call(*words) -> Answer:
        try:
            code: int | str | None = main([*map(str, words), "--json"])
        except SystemExit as end:
            code = end.code
        said = capsys.readouterr()
        return Answer(code, json.loads(said.out) if said.out else None, said.err)

    return call


@pytest.fixture(scope="session")
def hall():
    """The larger data set, where it is at hand."""
    path = Path(__file__).parents[3] / "shared" / "data" / "hall"
    if not path.is_dir():
        pytest.skip("needs the data set hall beside the project")
    return path
