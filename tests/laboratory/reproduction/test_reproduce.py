import re
from pathlib import Path

import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.laboratory.reproduction import methods, votes
from panoloc_mcl.laboratory.reproduction.bench import turned
from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.settings.validation import read_yaml
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.config import Override, config_from_mapping
from panoloc_mcl.tools.datasets import read_dataset

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A room with two lights and references enough for 15 eigenimages, in small panoramas."""
    path = tmp_path_factory.mktemp("room") / "data"
    grid = tuple((float(x), float(y)) for y in range(4) for x in range(5))
    return build_room(path, frames=6, geometry=PanoramaGeometry(90, 36, -50.0, 25.0), grid=grid, lights=("noon", "evening"))


@pytest.mark.slow
def test_the_quick_report_has_everything(room, own_cache, tmp_path, capsys):
    (room / "lux.csv").write_text("file,noon,evening_lux\n" + "".join(f"ref_{k}.png,{600 + k},{200 + k}\n" for k in range(20)))
    assert main(["reproduce", "--dataset", str(room), "--quick", "--out", str(tmp_path)]) == 0
    folder = tmp_path / "room"
    assert capsys.readouterr().out.strip() == str(folder)
    report = (folder / "report.md").read_text()
    titles = re.findall(r"^## (Table \d|Figure \d|Speed)", report, re.MULTILINE)
    assert titles == ["Table 1", "Table 2", *(f"Figure {number}" for number in range(1, 9)), "Speed"]
    for file in re.findall(r"\((figure_\d\.png)\)", report):
        assert (folder / file).read_bytes().startswith(b"\x89PNG")
    for number in (1, 3, 4, 5, 6, 7, 8):
        assert f"(figure_{number}.png)" in report
    assert "has no raw omnidirectional images" in report
    assert "| noon | 335 / 1288 / 690.9 / 248.8 | 600.0 / 619.0 / 609.5 / 5.9 |" in report
    for method in methods.METHODS:
        assert f"| noon | {method} | 1 | 1 |" in report
        assert f"| evening | {method} | 1 | 1 |" in report
    assert "| noon | paper | 10 | 10 | 225 | 225 | 100.0 (98.3–100.0) | (0) |" in report
    assert "Quick" in report
    for study in ("table_2", "figure_6", "figure_8"):
        assert (folder / study / "table.csv").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [(("--seeds", "0"), "0: must be at least 1"), (("--dataset", "nowhere"), "dataset = 'nowhere'")],
)
def test_faults_are_one_line(capsys, tmp_path, words, said):
    try:
        code: int | str | None = main(["reproduce", *words, "--out", str(tmp_path)])
    except SystemExit as end:
        code = end.code
    error = capsys.readouterr().err
    assert code == 2
    assert said in error
    assert error.count("\n") == 1


def test_seeds_are_as_many_as_runs_and_passes_ask_for(hall):
    dataset = read_dataset(hall)
    effort = methods.effort_for(dataset)
    passes = {
        light: sum(
            methods.passed(drive.groundtruth.at(drive.times), dataset)
            for name, drive in dataset.sequences.items()
            if drive.groundtruth is not None and name.startswith(light)
        )
        for light in methods.LIGHTS
    }
    assert effort.seeds * 5 >= methods.RUNS
    assert 0.95 * effort.seeds * min(passes.values()) >= methods.PASSES


@pytest.mark.parametrize(("method", "config"), list(zip(methods.METHODS, ("paper", "kalman", "global"), strict=True)))
def test_methods_are_the_shipped_configurations(method, config):
    shipped = config_from_mapping(read_yaml(CONFIGS / f"{config}.yaml"))
    found = config_from_mapping({}, method, [Override(key, value, key) for key, value in methods.METHODS[method].items()])
    assert (found.localizer, found.observation) == (shipped.localizer, shipped.observation)


def test_a_panorama_is_turned_back_by_its_heading():
    image = np.zeros((2, 360))
    # What is straight ahead of a robot that looks 30 degrees to the left is 30 degrees to the left of one that looks along x.
    image[:, 0] = 1.0
    back = turned(image, np.radians(30.0))
    geometry = PanoramaGeometry(360, 2, -10.0, 10.0)
    assert geometry.azimuth_of_column(int(np.argmax(back[0]))) == pytest.approx(np.radians(30.0))


def test_the_curve_of_votes_is_described():
    turns = votes._TURNS_DEG
    seen = np.stack([np.exp(-0.5 * (turns / 8.0) ** 2), np.full(len(turns), 0.3)], axis=1)
    # exp(-t^2 / 2 s^2) is a half at t = s sqrt(2 ln 2) and 0.3 at t = s sqrt(-2 ln 0.3) = 12.4.
    assert votes.half_width(seen[:, 0]) == pytest.approx(8.0 * np.sqrt(2.0 * np.log(2.0)), abs=0.1)
    assert votes.shape_of(seen, 0).startswith(
        "the right place leads from -12° to 12°; its votes are half of those unturned at 9.4°"
    )
    assert "does not lead" in votes.shape_of(seen, 1)
    assert votes.up_to((seen[:, 0] > 0.3).astype(float), 0.9) == "up to 12°"
