"""The study of claims, on a small room."""

from typing import Any

import pytest

from panoloc_mcl.laboratory.studies import consistency
from panoloc_mcl.laboratory.studies.claims import Claims, kept
from panoloc_mcl.laboratory.studies.consistency import Condition, study
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.tools.config.model import RunConfig


def test_conditions_have_names_of_their_own() -> None:
    names = [condition.name for condition in consistency.CONDITIONS]
    assert len(set(names)) == len(names)


def test_a_name_that_there_is_not(room) -> None:
    with pytest.raises(ConfigError, match="no such condition; known: as it is"):
        study(RunConfig(dataset=str(room)), rows=["as it was"])


@pytest.mark.slow
def test_rows_count_drives_and_images_and_hold_errors_against_claims(room, monkeypatch) -> None:
    conditions = (
        Condition("as it is", by_light=True),
        Condition("standing", standing=5),
        Condition("tilted", images="lean:1.0"),
        Condition("poses off", "pose_noise:mild,xy_m=0.05,theta_deg=1", mended=False, surveyed=True),
    )
    monkeypatch.setattr(consistency, "CONDITIONS", conditions)
    kept: list[Any] = []
    report = study(RunConfig(dataset=str(room)), keep=kept.append, surveys=2)
    table, by_survey = report.data()["tables"]
    rows = {row["condition"]: row for row in table["rows"]}
    assert {"standing", "tilted", "poses off"} < set(rows)
    assert len(kept) == len(conditions)
    assert rows["standing"]["images"] == 16 * 5 * rows["standing"]["drives"]
    assert (rows["poses off"]["surveys"], rows["tilted"]["surveys"]) == (2, None)
    # Other errors were drawn for each survey, and the row has the images of all.
    first, second = by_survey["rows"]
    assert first["one image: mm, median"] != second["one image: mm, median"]
    assert first["images"] + second["images"] == rows["poses off"]["images"]
    for row in rows.values():
        assert row["images"] >= row["drives"] >= 1


@pytest.mark.parametrize(("drives", "surveys"), [(4, 4), (12, 4), (4, 8), (4, 6), (4, 1)])
def test_drives_are_spread_over_surveys(drives: int, surveys: int) -> None:
    names: Any = [f"noon_{number:02d}" for number in range(drives)]
    pairs = consistency._shared_out(names, surveys)
    assert len(set(pairs)) == len(pairs) == max(drives, surveys)
    assert {survey for survey, _ in pairs} == set(range(surveys))
    assert {drive for _, drive in pairs} == set(names)
    assert [survey for survey, _ in pairs] == sorted(survey for survey, _ in pairs)


def test_claims_that_were_kept_are_not_computed_again(tmp_path) -> None:
    claims = Claims({"noon_00"}, 2, [[0.001] * 12], [])
    computed = []

    def compute() -> Claims:
        computed.append(1)
        return claims

    for _ in range(2):
        assert kept(tmp_path, ("hall", 1), compute).data() == claims.data()
    assert len(computed) == 1
    kept(tmp_path, ("hall", 2), compute)
    assert len(computed) == 2
    # One that is damaged is made anew.
    for file in tmp_path.iterdir():
        file.write_text("{")
    assert kept(tmp_path, ("hall", 1), compute).data() == claims.data()
    assert len(computed) == 3
    kept(None, ("hall", 1), compute)
    assert len(computed) == 4


@pytest.mark.slow
def test_an_interrupted_study_goes_on(room, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(
        consistency, "CONDITIONS", (Condition("as it is", by_light=True), Condition("tilted", images="lean:1.0"))
    )
    config = RunConfig(dataset=str(room))
    whole = study(config, cells=tmp_path, also=[str(room)])
    monkeypatch.setattr(consistency, "_map", None)
    assert study(config, cells=tmp_path, also=[str(room)]).data() == whole.data()
