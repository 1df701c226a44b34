import csv
import importlib.util
import re
import sys
from pathlib import Path

import pytest

from panoloc_mcl.files import CACHE_VARIABLE

SCRIPT = Path(__file__).parents[1] / "scripts" / "ablate_observation.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("ablate_observation", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture
def ablate(script, small_room, tmp_path, monkeypatch):
    """Run it on the small room; exit code, rows of the table by model and condition."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))

    def run(*words, out="out"):
        code = script.main(["--dataset", str(small_room.path), "--out", str(tmp_path / out), *words])
        tables = sorted((tmp_path / out).glob("ablation/*/table.csv"))
        rows = [row for table in tables for row in csv.DictReader(table.read_text().splitlines())]
        return code, {(row["model"], row["condition"]): row for row in rows}

    return run


def test_a_table_of_two_models_and_two_conditions(ablate, tmp_path, capsys):
    code, rows = ablate(
        "--models", "votes", "orientation_correlation", "--conditions", "clean", "bars:0.5+random_pixels:0.25", "--every", "4"
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
    (written,) = tmp_path.glob("out/ablation/*/table.md")
    assert re.fullmatch(r"\d{8}_\d{6}", written.parent.name)
    printed = capsys.readouterr().out
    assert printed == written.read_text()
    assert printed.count("\n| ") == 2 + len(rows)
    assert sorted(path.name for path in written.parent.iterdir()) == ["table.csv", "table.md"]


def test_the_seed_decides_all_but_the_times(ablate):
    words = ("--models", "orientation_correlation", "--conditions", "random_pixels:0.5", "--every", "6")
    tables = [ablate(*words, "--seed", seed, out=f"out{index}")[1] for index, seed in enumerate("334")]
    first, again, other = ({**next(iter(rows.values())), "time / matchTemplate": ""} for rows in tables)
    assert first == again
    assert first != other


def test_a_model_that_cannot_be_built_is_a_row_and_the_rest_goes_on(ablate, capsys):
    # The small room spans fewer eigenimages than are asked for.
    code, rows = ablate("--models", "eigenspace", "fourier_signature*", "--conditions", "clean", "--every", "12")
    assert code == 1
    assert "observation.eigenspace.components" in rows["eigenspace", "all"]["error"]
    assert rows["eigenspace", "all"]["position median m"] == ""
    assert {model for model, _ in rows} == {"eigenspace", "fourier_signature", "fourier_signature/magnitudes"}
    assert rows["fourier_signature", "clean"]["n"] == "1"
    assert "| error |" in capsys.readouterr().out


def test_a_model_that_fails_on_a_condition_is_a_row_and_the_rest_goes_on(ablate, script, monkeypatch):
    add = script.Bench.add

    def failing(self, row, frame, recipe):
        if recipe.text == "noise:5":
            raise ZeroDivisionError("no\nluck")
        add(self, row, frame, recipe)

    monkeypatch.setattr(script.Bench, "add", failing)
    code, rows = ablate("--models", "orientation_correlation", "--conditions", "noise:5", "clean", "--every", "6")
    assert code == 1
    assert rows["orientation_correlation", "noise:5"]["error"] == "ZeroDivisionError: no luck"
    assert rows["orientation_correlation", "noise:5"]["n"] == "0"
    assert rows["orientation_correlation", "clean"]["n"] == "2"


def test_an_image_that_says_nothing_counts_as_a_miss(ablate):
    _, rows = ablate("--models", "votes/no_virtual_places", "--conditions", "gain:0", "--every", "4")
    row = rows["votes/no_virtual_places", "gain:0"]
    assert row["says nothing"] == row["n"] == "3"
    assert float(row["within 0.25 m 3 deg"]) == 0.0
    assert row["position median m"] == "inf"


def test_a_model_without_headings_has_no_figures_of_them(ablate):
    _, rows = ablate("--models", "fourier_signature/magnitudes", "--conditions", "clean", "--every", "4")
    row = rows["fourier_signature/magnitudes", "clean"]
    assert row["heading median deg"] == row["within 0.25 m 3 deg"] == ""
    assert float(row["position median m"]) >= 0.0


def test_settings_of_every_row_are_known_and_differ(script):
    settings = {name: script.settings_of(name).model_dump_json() for name in script.MODELS}
    assert len(set(settings.values())) == len(settings)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--models", "vote"), "--models vote: no such model; did you mean 'votes'?"),
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
