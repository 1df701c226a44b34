"""Maps of a few references, blind streams, another building: the table, and that it would see a localizer that lies."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.laboratory.studies.robustness.doubt import FOREIGN, PARTS, STREAMS, study
from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.tools.config import config_from_mapping

_GRID = np.array([(x, y) for y in range(6) for x in range(7)], dtype=np.float64)


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("doubt") / "room"
    geometry = PanoramaGeometry(120, 48, -50.0, 25.0)
    build_room(path, frames=9, geometry=geometry, grid=((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)), lights=("noon",))
    return path


@pytest.mark.parametrize("name", list(PARTS))
def test_parts_are_some_of_the_references_each_once(name: str) -> None:
    chosen = PARTS[name](_GRID)
    assert 2 <= len(chosen) <= len(_GRID) // 2
    assert len(set(chosen.tolist())) == len(chosen)


def test_lines_and_halves_are_what_they_say() -> None:
    assert np.ptp(_GRID[PARTS["a line along x"](_GRID), 1]) == 0.0
    assert np.ptp(_GRID[PARTS["a line along y"](_GRID), 0]) == 0.0
    assert np.ptp(_GRID[PARTS["a diagonal"](_GRID)], axis=0).min() > 2.0
    assert _GRID[PARTS["the half of low x"](_GRID), 0].max() <= 3.0


@pytest.mark.slow
def test_every_row_is_driven_and_a_lie_is_seen(room: Path, monkeypatch) -> None:
    config = config_from_mapping({"dataset": str(room)}, "test")
    honest = study(config, foreign=str(room))
    rows = honest.tables[0].data()["rows"]
    assert [row["what"] for row in rows] == [*PARTS, *STREAMS, FOREIGN, "all"]
    assert all(row["answers"] > 0 for row in rows)
    assert all(row["runs"] == 1 for row in rows[: len(PARTS) + len(STREAMS)])
    add_image = Localizer.add_image

    def lying(self, timestamp, image):
        estimate = add_image(self, timestamp, image)
        return None if estimate is None else replace(estimate, pose=np.full(3, 9.0), status=Status.CONVERGED)

    monkeypatch.setattr(Localizer, "add_image", lying)
    lied = study(config).tables[0].data()["rows"][-1]["sure and wrong"]
    assert lied["hits"] == lied["trials"] > 0
