"""A build that was killed goes on after its last part, and gives the same map."""

from pathlib import Path

import numpy as np
import pytest
from oracles.rooms import BareRoom
from oracles.scenes import grid

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.eigenspace import pca
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.settings.observation import VirtualPlacesSettings, VotesSettings
from panoloc_mcl.robot.unfinished import Parts

REFERENCES = BareRoom().references(PanoramaGeometry(60, 24, -50.0, 25.0), grid(3, 2))
SETTINGS = VotesSettings(
    columns=60, components=12, calibration_references=0, virtual_places=VirtualPlacesSettings(wall_distances=6, threads=1)
)


class Killed(BaseException):
    pass


def built(folder: Path | None, until: tuple[str, int] = ("", 0)) -> tuple[dict[str, np.ndarray], list[tuple[str, int]]]:
    """The arrays of a map, and the steps of its making that were told; killed at one of them."""
    told: list[tuple[str, int]] = []

    def progress(done: int, total: int, what: str) -> None:
        told.append((what, done))
        if (what, done) == until:
            raise Killed

    return VotesModel.build(REFERENCES, SETTINGS, 0, progress, folder).arrays(), told


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pca, "_BASIS_IMAGES", 40)
    monkeypatch.setattr(pca, "_KEPT_TOGETHER", 32)


def test_a_build_that_was_killed_goes_on_and_ends_the_same(tmp_path: Path) -> None:
    expected, every = built(None)
    views = max(done for what, done in every if what == "views")
    for until in (("depth of references", 3), ("views", 40 + 70)):
        folder = tmp_path / f"{until}"
        with pytest.raises(Killed):
            built(folder, until)
        arrays, told = built(folder)
        assert arrays.keys() == expected.keys()
        assert all(np.array_equal(arrays[name], expected[name]) for name in expected)
        if until == ("views", 40 + 70):
            # Depths, poses and two whole parts of the views are not made again; the basis is.
            assert {what for what, _ in told} == {"views"}
            assert [done for _, done in told] == [*range(1, 41), *range(40 + 65, views + 1)]


def test_parts_of_other_references_and_damaged_ones_are_made_anew(tmp_path: Path) -> None:
    made: list[slice] = []

    def make(block: slice) -> dict[str, np.ndarray]:
        made.append(block)
        return {"squares": np.arange(block.start, block.stop) ** 2}

    def squares(key: str) -> list[int]:
        return [int(one) for _, found in Parts(tmp_path, key).each("some", 10, 4, make) for one in found["squares"]]

    assert squares("one") == squares("one") == [n * n for n in range(10)]
    assert made == [slice(0, 4), slice(4, 8), slice(8, 10)]
    (tmp_path / "one-some-1-4-8.npz").write_bytes(b"damaged")
    assert squares("one") == [n * n for n in range(10)]
    assert made[3:] == [slice(4, 8)]
    assert squares("other") == [n * n for n in range(10)]
    assert len(made) == 7
