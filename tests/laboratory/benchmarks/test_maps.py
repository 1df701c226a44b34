"""The large maps that are measured are maps: every tile answers as the map that it was made from."""

from pathlib import Path

import numpy as np
import pytest
from oracles.rooms import BareRoom
from oracles.scenes import grid

from panoloc_mcl.laboratory.benchmarks.maps import tiled
from panoloc_mcl.robot.camera import PanoramaCamera, PanoramaGeometry
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.robot.settings.observation import VirtualPlacesSettings, VotesSettings
from panoloc_mcl.tools.datasets import read_dataset
from panoloc_mcl.tools.datasets.writer import DatasetWriter

ROOM, GEOMETRY = BareRoom(), PanoramaGeometry(90, 36, -50.0, 25.0)


@pytest.fixture(scope="module")
def bare(tmp_path_factory) -> Path:
    writer = DatasetWriter(
        tmp_path_factory.mktemp("bare") / "data", "bare", PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
    )
    writer.add_references(list(ROOM.references(GEOMETRY, grid(3, 2)).pixels), np.column_stack([grid(3, 2), np.zeros(6)]))
    return writer.finish()


@pytest.fixture(scope="module")
def built(bare) -> PanoramaMap:
    votes = VotesSettings(components=12, virtual_places=VirtualPlacesSettings(spacing_m=0.5, wall_distances=6))
    return PanoramaMap.build(read_dataset(bare), ObservationSettings(votes=votes))


@pytest.mark.slow
@pytest.mark.parametrize("tiles", [1, 3])
def test_every_tile_answers_as_the_map(tiles: int, built, tmp_path: Path) -> None:
    many = tiled(built, tiles)
    many.save(tmp_path / "map")
    model, single = PanoramaMap.load(tmp_path / "map").observation_model(), built.observation_model()
    assert len(model.places) == tiles * len(single.places)
    assert len(many.references) == tiles * 6
    assert len(np.unique(model.places.positions, axis=0)) == len(model.places)
    image = ROOM.panorama(GEOMETRY, (0.5, 0.5, 1.0))
    votes, expected = model.observe(image).votes, single.observe(image).votes
    # In each tile the places are those of the map, moved.
    for corner in many.references.positions[::6]:
        at = model.places.nearest(single.places.positions + corner)
        assert model.places.positions[at] == pytest.approx(single.places.positions + corner)
        assert votes[:, at] == pytest.approx(expected, abs=1e-5)


def test_a_peer_must_be_there(ask, bare) -> None:
    answer = ask("benchmark", "building", "--dataset", bare, "--peer", "nothing:build")
    assert (answer.code, answer.err.startswith("--peer nothing:build")) == (2, True)


@pytest.mark.slow
def test_building_beside_the_plain_one_of_the_tests(ask, bare) -> None:
    answer = ask("benchmark", "building", "--dataset", bare, "--repeats", "1", "--peer", "oracles.building:build")
    assert answer.code == 0
    assert answer.rows()[-1]["what"] == "oracles.building:build"
    assert answer.rows()[-1]["time / the first (95 %)"]["ratio"] > 0.0
