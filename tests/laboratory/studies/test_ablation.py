import json
from pathlib import Path

import pytest
import yaml
from oracles.furnished_room import build_room

from panoloc_mcl.laboratory.studies import ablation
from panoloc_mcl.laboratory.studies.ablation import NEAREST, PLACE_ALONE, TIME, WITHIN
from panoloc_mcl.laboratory.studies.single_images import TIERS
from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.observation import MODELS

POSITION, HEADING = "position m: median / p95", "heading degrees: median"


@pytest.fixture
def ablate(ask, small_room):
    """Run it on the small room; the answer, and the rows of the table with all figures by model and condition."""

    def run(*words):
        answer = ask("study", "ablation", "--dataset", small_room.path, *words)
        rows = answer.rows(1) if answer.report else []
        return answer, {(row["model"], row["condition"]): row for row in rows}

    return run


@pytest.mark.slow
def test_a_table_of_two_models_and_two_conditions(ablate, tmp_path):
    answer, rows = ablate(
        *("--models", "votes", "orientation_correlation", "--switches", "none", "--every", "4", "--out", tmp_path),
        *("--conditions", "clean", "bars:0.5+random_pixels:0.25"),
    )
    assert answer.code == 0
    assert set(rows) == {(m, c) for m in ("votes", "orientation_correlation") for c in ("clean", "bars:0.5+random_pixels:0.25")}
    best = rows["votes", "clean"]
    assert (best["light"], best["drives"], best["images"], best["error"]) == ("noon", 1, 3, "")
    assert best[POSITION]["median"] < 0.05
    assert best[HEADING]["median"] < 2.0
    assert best[WITHIN[0]]["rate"] == 1.0
    # One drive tells little of others.
    assert best[WITHIN[0]]["interval95"][0] < 0.3
    assert best[TIME]["ratio"] > 0.0
    assert best[POSITION]["median"] < rows["orientation_correlation", "clean"][POSITION]["median"]
    assert rows["votes", "bars:0.5+random_pixels:0.25"][TIME] is None
    assert [row["model"] for row in answer.rows(0)] == ["votes", "orientation_correlation"]
    assert answer.rows(0)[0]["clean, noon"].endswith(" mm, 100 / 100")
    assert json.loads((tmp_path / "report.json").read_text())["tables"] == answer.report["tables"]
    assert "| votes | noon | clean | 1 | 3 |" in (tmp_path / "report.md").read_text()


@pytest.fixture(scope="module")
def room_for_eigenimages(tmp_path_factory):
    """References enough for the paper's 15 eigenimages, in small panoramas."""
    path = tmp_path_factory.mktemp("room") / "data"
    grid = tuple((float(x), float(y)) for y in range(4) for x in range(5))
    return build_room(path, frames=4, geometry=PanoramaGeometry(90, 36, -50.0, 25.0), grid=grid, lights=("noon",))


@pytest.mark.slow
def test_votes_and_the_paper(ablate, room_for_eigenimages):
    words = ("--dataset", str(room_for_eigenimages), "--every", "24", "--models", "votes", "paper")
    answer, rows = ablate(*words, "--switches", "no_r*", "hypotheses_10", "--conditions", "clean", "spatial_light")
    assert answer.code == 0
    models = ("votes", "votes/no_refinement", "paper", "paper/hypotheses_10")
    assert set(rows) == {(model, condition) for model in models for condition in ("clean", "spatial_light")}
    assert {row["images"] for row in rows.values()} == {1}
    assert rows["votes", "clean"][WITHIN[0]]["rate"] == 1.0
    assert rows["votes/no_refinement", "clean"][POSITION]["median"] > rows["votes", "clean"][POSITION]["median"]


def test_every_model_stands_in_the_short_table():
    assert set(ablation.SHORT) <= set(ablation.MODELS)
    of_models = {name.partition("/")[0] for name in ablation.MODELS}
    # Methods of today give one pose and no votes; they stand in a comparison of their own.
    today = yaml.safe_load((Path(__file__).parents[3] / "configs" / "compare_today.yaml").read_text())["observations"]
    of_today = {"colmap_sift", "xfeat", "template_matching", "bag_of_words"}
    assert of_today <= set(today)
    assert {name.partition("/")[0] for name in ablation.SHORT} == set(MODELS) - of_today == of_models


@pytest.mark.slow
def test_the_seed_decides_all_but_the_times(ablate):
    words = ("--models", "orientation_correlation", "--conditions", "random_pixels:0.5", "--every", "6")
    rows = [ablate(*words, "--seed", seed)[1] for seed in "334"]
    first, again, other = ({**next(iter(found.values())), TIME: None} for found in rows)
    assert first == again
    assert first != other


@pytest.mark.slow
def test_a_model_that_cannot_be_built_is_a_row_and_the_rest_goes_on(ablate):
    # The small room spans fewer eigenimages than are asked for.
    words = ("--models", "eigenspace", "fourier_signature", "--switches", "magnitudes", "--conditions", "clean")
    answer, rows = ablate(*words, "--every", "12")
    assert answer.code == 0
    assert "observation.eigenspace.components" in rows["eigenspace", "all"]["error"]
    assert rows["eigenspace", "all"][POSITION]["median"] is None
    assert {model for model, _ in rows} == {"eigenspace", "fourier_signature", "fourier_signature/magnitudes"}
    assert rows["fourier_signature", "clean"]["images"] == 1
    # A model that gives no heading is judged by the place alone: the drive looks in all directions.
    row = rows["fourier_signature/magnitudes", "clean"]
    assert row[HEADING] == PLACE_ALONE
    assert row[WITHIN[0]]["hits"] == (row[POSITION]["median"] <= TIERS[0][0])


def test_a_model_that_fails_on_a_condition_is_a_row_and_the_rest_goes_on(ablate, monkeypatch):
    add = ablation.Bench.add

    def failing(self, row, frame, recipe, timed):
        if recipe.text == "noise:5":
            raise ZeroDivisionError("no\nluck")
        add(self, row, frame, recipe, timed)

    monkeypatch.setattr(ablation.Bench, "add", failing)
    _, rows = ablate("--models", "orientation_correlation", "--conditions", "noise:5", "clean", "--every", "6")
    assert rows["orientation_correlation", "noise:5"]["error"] == "ZeroDivisionError: no luck"
    assert rows["orientation_correlation", "noise:5"]["images"] == 0
    assert rows["orientation_correlation", "clean"]["images"] == 2


@pytest.mark.slow
def test_an_image_that_says_nothing_counts_as_a_miss(ablate):
    _, rows = ablate("--models", "votes", "--switches", "no_virtual_places", "--conditions", "gain:0", "--every", "4")
    row = rows["votes/no_virtual_places", "gain:0"]
    assert row["says nothing"] == row["images"] == 3
    assert row[WITHIN[0]]["rate"] == 0.0


@pytest.mark.slow
def test_the_paper_with_its_heading_given_is_judged_by_the_place(ablate, room_for_eigenimages):
    words = ("--dataset", str(room_for_eigenimages), "--every", "2", "--models", "paper", "--switches", "known_heading")
    _, rows = ablate(*words, "--conditions", "clean")
    assert rows["paper/known_heading", "clean"][HEADING] == PLACE_ALONE
    given, asked = (rows[name, "clean"][NEAREST]["hits"] for name in ("paper/known_heading", "paper"))
    assert given >= asked


def test_settings_of_every_row_are_known_and_differ():
    settings = {ablation.settings_of(name).model_dump_json() for name in ablation.MODELS if name != "paper/known_heading"}
    assert len(settings) == len(ablation.MODELS) - 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--models", "vote"), "--models vote: no such model; did you mean 'votes'?"),
        (("--models", "spinning", "--switches", "no_median"), "no such switch of these models; known: raw_energy"),
        (("--switches", "raw_energi"), "did you mean 'raw_energy'?"),
        (("--conditions", "bar:0.7"), "did you mean 'bars'?"),
        (("--conditions", "bars:7"), "share = 7"),
        (("--dataset", "no_such_place"), "no_such_place"),
        (("--every", "0"), "0: must be at least 1"),
    ],
)
def test_faults_are_one_line(ablate, tmp_path, words, said):
    answer, _ = ablate("--out", tmp_path, *words)
    assert (answer.code, answer.report) == (2, None)
    assert said in answer.err
    assert answer.err.count("\n") == 1
    assert not list(tmp_path.iterdir())
