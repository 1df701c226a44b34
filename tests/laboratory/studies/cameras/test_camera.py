"""The study of cameras, on a small room."""

from typing import Any

import pytest

from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.laboratory.studies.cameras import camera
from panoloc_mcl.laboratory.studies.cameras.camera import CASES, Case, study
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.tools.config.model import RunConfig
from panoloc_mcl.tools.datasets import read_dataset


def test_cases_have_names_of_their_own_and_recipes_that_are_read() -> None:
    names = [case.name for case in CASES] + [name for name, *_ in camera.CAMERAS]
    assert len(set(names)) == len(names)
    for case in CASES:
        assert parse_recipe(case.recipe).changes_data == (case.recipe != "clean")


def test_a_name_that_there_is_not(room) -> None:
    with pytest.raises(ConfigError, match="no such case; known: as it is"):
        study(RunConfig(dataset=str(room)), rows=["as it was"])


@pytest.mark.slow
def test_a_wrong_height_costs_accuracy_and_is_found(small_room, tmp_path, monkeypatch) -> None:
    cases = (Case("as it is", "clean", found=False), Case("height", "height:strong"))
    monkeypatch.setattr(camera, "CASES", cases)
    monkeypatch.setattr(camera, "CAMERAS", ())
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path / "cache"))
    kept: list[Any] = []
    # Odometry is held to as when the factors below were set: this is about the camera.
    motion = {"slip_noise_from_translation": 0.0}
    config = RunConfig(dataset=str(small_room.path), map={"mend": False}, localizer={"motion": motion})
    report = study(config, folder=tmp_path, keep=kept.append)
    assert len(kept) == len(cases)
    tables = report.data()["tables"]
    rows = {row["case"]: row for row in tables[0]["rows"]}
    right, before, after = (
        [float(part) for part in rows[name][f"{when}: mm, median / p95"].split(" / ")]
        for name, when in (("as it is", "before"), ("height", "before"), ("height", "after"))
    )
    assert before[0] > 2.5 * right[0]
    # Of twelve images this is one image.
    assert before[1] > 2.5 * right[1]
    assert before[0] > 2.5 * after[0]
    assert after[0] < 0.5 * before[0]
    assert rows["height"]["images"] == rows["as it is"]["images"] == len(next(iter(small_room.sequences.values())))
    (height,) = (row for row in tables[-1]["rows"] if row["unknown"] == "height [m]")
    assert float(height["before"]) == pytest.approx(0.7)
    assert float(height["after"]) == pytest.approx(0.6, abs=0.03)
    # The data set that was made, and that with the camera as found, can be looked at.
    assert read_dataset(tmp_path / "height_calibrated").camera.height_m == pytest.approx(float(height["after"]), abs=1e-3)
