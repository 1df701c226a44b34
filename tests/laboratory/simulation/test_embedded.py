"""The data set in the package is what its command makes: the ways exactly, the pictures but for noise of the light."""

from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.laboratory.simulation.settings import load_simulation
from panoloc_mcl.laboratory.simulation.simulate import Simulation
from panoloc_mcl.tools import datasets
from panoloc_mcl.tools.datasets import read_image
from panoloc_mcl.tools.datasets.trajectory import read_tum

CONFIG = Path(__file__).parents[3] / "configs" / "simulate_embedded.yaml"
SHIPPED = Path(datasets.__file__).parent / "embedded_hall"


def test_it_is_small_enough_to_be_shipped():
    assert sum(path.stat().st_size for path in SHIPPED.rglob("*") if path.is_file()) <= 8_000_000


def test_references_and_drives_are_those_of_the_configuration():
    simulation = Simulation(load_simulation(CONFIG), CONFIG.parent)
    rows = np.loadtxt(SHIPPED / "references" / "poses.csv", delimiter=",", skiprows=1, usecols=(1, 2, 3))
    assert np.array_equal(rows, simulation.references)
    assert {folder.name for folder in (SHIPPED / "sequences").iterdir()} == {one.name for one in simulation._sequences}
    for sequence in simulation._sequences:
        folder = SHIPPED / "sequences" / sequence.name
        for name, planned in (("groundtruth", sequence.truth), ("odometry", sequence.odometry)):
            shipped = read_tum(folder / f"{name}.tum")
            assert np.allclose(shipped.times, planned.times, atol=1e-9)
            assert np.allclose(shipped.poses, planned.poses, atol=1e-8)


@pytest.mark.slow
def test_pictures_are_those_of_the_scene(tmp_path, monkeypatch):
    pytest.importorskip("mitsuba")
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path / "cache"))
    config = load_simulation(CONFIG, ["sequences=[]", "rendering.samples=16"])

    class OneIsEnoughError(Exception):
        pass

    def stop(done: int, total: int, what: str) -> None:
        if what == "frames":
            raise OneIsEnoughError

    with pytest.raises(OneIsEnoughError):
        Simulation(config, CONFIG.parent).run(tmp_path / "data", stop, lambda text: None)
    found, shipped = (
        read_image(folder / "references" / "ref_000.png").astype(float) for folder in (tmp_path / "data", SHIPPED)
    )
    difference = np.abs(found - shipped)
    assert np.median(difference) <= 2.0
    assert np.corrcoef(found.ravel(), shipped.ravel())[0, 1] >= 0.97
    elsewhere = read_image(SHIPPED / "references" / "ref_001.png").astype(float)
    assert np.corrcoef(elsewhere.ravel(), shipped.ravel())[0, 1] < 0.9
