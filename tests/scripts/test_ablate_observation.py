import csv
import re

import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.observation import MODELS


@pytest.fixture(scope="module")
def script(load_script):
    return load_script("ablate_observation")


@pytest.fixture
def ablate(script, small_room, tmp_path, own_cache):
    """Run it on the small room; exit code, rows of the table by model and condition."""

    def run(*words, out="out"):
        code = script.main(["--dataset", str(small_room.path), "--out", str(tmp_path / out), *words])
        tables = sorted((tmp_path / out).glob("ablation/*/table.csv"))
        rows = [row for table in tables for row in csv.DictReader(table.read_text().splitlines())]
        return code, {(row["model"], row["condition"]): row for row in rows}

    return run


def test_a_table_of_two_models_and_two_conditions(ablate, tmp_path, capsys):
    code, rows = ablate(
        *("--models", "votes", "orientation_correlation", "--switches", "none", "--every", "4"),
        *("--conditions", "clean", "bars:0.5+random_pixels:0.25"),
    )
    assert code == 0
    assert set(rows) == {(m, c) for m in ("votes", "orientation_correlation") for c in ("clean", "bars:0.5+random_pixels:0.25")}
    best = rows["votes", "clean"]
    assert best["light"] == "noon"
    assert best["n"] == "3"
    assert float(best["position median m"]) < 0.05
    assert float(best["heading median deg"]) < 2.0
    assert float(best["within 0.25 m 3 deg"]) == 1.0
    assert 0.0 < float(best["within 0.25 m 3 deg low"]) < 1.0
    assert float(best["time / matchTemplate"]) > 0.0
    assert float(rows["votes", "clean"]["position median m"]) < float(
        rows["orientation_correlation", "clean"]["position median m"]
    )
    assert rows["votes", "bars:0.5+random_pixels:0.25"]["time / matchTemplate"] == ""
    (written,) = tmp_path.glob("out/ablation/*/table.md")
    assert re.fullmatch(r"\d{8}_\d{6}", written.parent.name)
    assert written.read_text().count("\n| ") == 2 + len(rows)
    assert sorted(path.name for path in written.parent.iterdir()) == ["readme.md", "table.csv", "table.md"]
    assert capsys.readouterr().out == (written.parent / "readme.md").read_text()


@pytest.fixture(scope="module")
def room_for_eigenimages(tmp_path_factory):
    """References enough for the paper's 15 eigenimages, in small panoramas."""
    path = tmp_path_factory.mktemp("room") / "data"
    grid = tuple((float(x), float(y)) for y in range(4) for x in range(5))
    return build_room(path, frames=4, geometry=PanoramaGeometry(90, 36, -50.0, 25.0), grid=grid, lights=("noon",))


def test_votes_and_the_paper(ablate, script, room_for_eigenimages):
    words = ("--dataset", str(room_for_eigenimages), "--every", "24", "--models", "votes", "paper")
    code, rows = ablate(*words, "--switches", "no_r*", "hypotheses_10", "--conditions", "clean", "spatial_light")
    assert code == 0
    models = ("votes", "votes/no_refinement", "paper", "paper/hypotheses_10")
    assert set(rows) == {(model, condition) for model in models for condition in ("clean", "spatial_light")}
    assert {row["n"] for row in rows.values()} == {"1"}
    assert float(rows["votes", "clean"][script.WITHIN]) == 1.0
    assert float(rows["votes/no_refinement", "clean"]["position median m"]) > float(rows["votes", "clean"]["position median m"])


def test_every_model_stands_in_the_short_table(script):
    assert set(script.SUMMARY) <= set(script.MODELS)
    assert (
        {name.partition("/")[0] for name in script.SUMMARY} == set(MODELS) == {name.partition("/")[0] for name in script.MODELS}
    )


def test_the_short_table_is_made_of_tables_of_several_runs(script, ablate, tmp_path, capsys):
    for part, model in enumerate(("votes", "fourier_signature")):
        words = ("--models", model, "--switches", "magnitudes" if part else "none", "--conditions", "clean", "bars:0.7")
        ablate(*words, "--every", "6", out=f"part{part}")
    tables = [str(table) for part in range(2) for table in tmp_path.glob(f"part{part}/ablation/*/table.csv")]
    capsys.readouterr()
    assert script.main(["--summary", *tables]) == 0
    lines = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert lines[0] == ["| model", "images a light", "clean, noon", "bars:0.7 |"]
    assert [line[0] for line in lines[2:]] == ["| votes", "| fourier_signature"]
    assert re.fullmatch(r"[\d.]+ mm, 100 / 100", lines[2][2])


def test_rates_of_the_short_table_are_over_all_lights(script):
    def row(light, images, within):
        return {
            **{"model": "votes", "light": light, "condition": "tilt:2", "n": str(images), "heading median deg": "0.1"},
            **{script.WITHIN: str(within), script.NEAREST: "0.5"},
        }

    text = script.summary_of([row("noon", 30, 1.0), row("evening", 10, 0.0)])
    assert "| votes | 10–30 | 75 / 50 |" in text


@pytest.mark.parametrize("content", [None, "", "a,b\n1,2\n", "\x00\xff"])
def test_tables_that_are_none(script, tmp_path, capsys, content):
    path = tmp_path / "table.csv"
    if content is not None:
        path.write_text(content, encoding="latin-1")
    assert script.main(["--summary", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: --summary {path}: ")


def test_the_seed_decides_all_but_the_times(ablate):
    words = ("--models", "orientation_correlation", "--conditions", "random_pixels:0.5", "--every", "6")
    tables = [ablate(*words, "--seed", seed, out=f"out{index}")[1] for index, seed in enumerate("334")]
    first, again, other = ({**next(iter(rows.values())), "time / matchTemplate": ""} for rows in tables)
    assert first == again
    assert first != other


def test_a_model_that_cannot_be_built_is_a_row_and_the_rest_goes_on(ablate, capsys):
    # The small room spans fewer eigenimages than are asked for.
    code, rows = ablate(
        "--models", "eigenspace", "fourier_signature", "--switches", "magnitudes", "--conditions", "clean", "--every", "12"
    )
    assert code == 1
    assert "observation.eigenspace.components" in rows["eigenspace", "all"]["error"]
    assert rows["eigenspace", "all"]["position median m"] == ""
    assert {model for model, _ in rows} == {"eigenspace", "fourier_signature", "fourier_signature/magnitudes"}
    assert rows["fourier_signature", "clean"]["n"] == "1"
    assert "error: eigenspace, all, all: observation.eigenspace.components" in capsys.readouterr().err


def test_a_model_that_fails_on_a_condition_is_a_row_and_the_rest_goes_on(ablate, script, monkeypatch):
    add = script.Bench.add

    def failing(self, row, frame, recipe, timed):
        if recipe.text == "noise:5":
            raise ZeroDivisionError("no\nluck")
        add(self, row, frame, recipe, timed)

    monkeypatch.setattr(script.Bench, "add", failing)
    code, rows = ablate("--models", "orientation_correlation", "--conditions", "noise:5", "clean", "--every", "6")
    assert code == 1
    assert rows["orientation_correlation", "noise:5"]["error"] == "ZeroDivisionError: no luck"
    assert rows["orientation_correlation", "noise:5"]["n"] == "0"
    assert rows["orientation_correlation", "clean"]["n"] == "2"


def test_an_image_that_says_nothing_counts_as_a_miss(ablate):
    _, rows = ablate("--models", "votes", "--switches", "no_virtual_places", "--conditions", "gain:0", "--every", "4")
    row = rows["votes/no_virtual_places", "gain:0"]
    assert row["says nothing"] == row["n"] == "3"
    assert float(row["within 0.25 m 3 deg"]) == 0.0
    assert row["position median m"] == "inf"


def test_a_model_without_headings_is_judged_by_the_place_alone(ablate, script):
    words = ("--models", "fourier_signature", "--switches", "magnitudes", "--conditions", "clean", "--every", "4")
    _, rows = ablate(*words)
    row = rows["fourier_signature/magnitudes", "clean"]
    assert row["heading median deg"] == "place alone"
    near = float(row["position median m"]) <= script.TIERS[0][0]
    # The drive looks in all directions, so headings of 0 would be wrong.
    assert (float(row[script.WITHIN]) >= 0.5) == near
    assert rows["fourier_signature", "clean"]["heading median deg"] != "place alone"


def test_the_paper_with_its_heading_given_is_judged_by_the_place(ablate, room_for_eigenimages):
    words = ("--dataset", str(room_for_eigenimages), "--every", "2", "--models", "paper", "--switches", "known_heading")
    _, rows = ablate(*words, "--conditions", "clean")
    assert rows["paper/known_heading", "clean"]["heading median deg"] == "place alone"
    given, asked = (float(rows[name, "clean"]["nearest place"]) for name in ("paper/known_heading", "paper"))
    assert given >= asked


def test_settings_of_every_row_are_known_and_differ(script):
    settings = {name: script.settings_of(name).model_dump_json() for name in script.MODELS if name != "paper/known_heading"}
    assert len(set(settings.values())) == len(settings)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--models", "vote"), "--models vote: no such model; did you mean 'votes'?"),
        (
            ("--models", "spinning", "--switches", "no_median"),
            "--switches no_median: no such switch of these models; known: raw_energy",
        ),
        (("--switches", "raw_energi"), "did you mean 'raw_energy'?"),
        (("--conditions", "bar:0.7"), "did you mean 'bars'?"),
        (("--conditions", "bars:7"), "share = 7"),
        (("--dataset", "no_such_place"), "no_such_place"),
    ],
)
def test_faults_are_one_line(script, tmp_path, capsys, words, said):
    assert script.main([*words, "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert said in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_thinning_must_be_a_count(script, capsys):
    with pytest.raises(SystemExit):
        script.main(["--every", "0"])
    assert "0: must be at least 1" in capsys.readouterr().err
