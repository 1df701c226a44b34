"""A later drive and a map in one graph."""

from dataclasses import replace

import numpy as np
import pytest

from panoloc_mcl.robot.geometry import compose
from panoloc_mcl.robot.map.joining import joined, settled_together, stacked
from panoloc_mcl.robot.map.keyframes import LOOP, Keyframes
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.tools.datasets import Dataset


@pytest.fixture(scope="module")
def half(small_room: Dataset) -> PanoramaMap:
    """A map of every second reference, with exact poses."""
    references = small_room.references
    every_second = replace(small_room, references=references.of(np.arange(0, len(references), 2)))
    return PanoramaMap.build(every_second, settings=MapSettings(file=None, mend=False))


@pytest.mark.slow
def test_what_comes_later_is_pulled_right_and_a_survey_stays(half: PanoramaMap, small_room: Dataset) -> None:
    rest = small_room.references.of(np.arange(1, len(small_room.references), 2))
    true = rest.standpoints
    off = compose(true, np.array([0.06, -0.04, np.radians(1.5)]))
    names = tuple(file.name for file in rest.files)
    count = len(names)
    later = replace(Keyframes.surveyed(names, off), times=np.arange(float(count)), drives=("later",) * count)
    together = settled_together(half, later, read_references(rest.moved_to(off)), lambda *_: None)
    first = len(half.keyframes)
    np.testing.assert_allclose(together.poses[:first], half.keyframes.poses, atol=2e-3)
    error = np.hypot(*(together.poses[first:] - true)[:, :2].T)
    assert np.median(error) < 0.3 * np.hypot(0.06, 0.04)
    assert np.median(np.abs(together.poses[first:, 2] - true[:, 2])) < np.radians(0.7)
    assert (together.edges.kinds == LOOP).sum() >= count


def test_numbers_of_edges_follow_their_keyframes(half: PanoramaMap) -> None:
    both = joined(half.keyframes, half.keyframes)
    count, edges = len(half.keyframes), len(half.keyframes.edges)
    assert len(both) == 2 * count
    np.testing.assert_array_equal(both.edges.first[edges:], half.keyframes.edges.first + count)
    images = stacked(half.references, half.references)
    assert len(images) == 2 * count
    assert images.sds is None
