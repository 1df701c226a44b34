"""Poses that cannot be true are found, named, and told from references that only stand alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from oracles.rooms import BareRoom
from oracles.scenes import grid, references, texture

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VirtualPlacesSettings, VotesSettings
from panoloc_mcl.robot.synthesis import (
    PoseCheck,
    ViewSynthesizer,
    check_poses,
    places_of,
    plausibility,
    sweep_profiles,
    synthetic_features,
    virtual_positions,
)

SETTINGS = VotesSettings(virtual_places=VirtualPlacesSettings(spacing_m=0.25))
GEOMETRY = PanoramaGeometry(180, 72, -50.0, 25.0)
POSITIONS = grid(4, 3)


@pytest.fixture(scope="module")
def right() -> ReferencePanoramas:
    return BareRoom(low=(-1.5, -1.2), high=(4.6, 3.7)).references(GEOMETRY, POSITIONS)


def check(world: ReferencePanoramas, settings: VotesSettings = SETTINGS, threads: int = 1) -> PoseCheck:
    profiles = sweep_profiles(world, 0.6, settings)
    return check_poses(ViewSynthesizer(world, profiles, 0.6), 1.0, settings, threads=threads)


def moved(world: ReferencePanoramas, changes: dict[int, tuple[float, float]]) -> ReferencePanoramas:
    positions = world.positions.copy()
    for index, position in changes.items():
        positions[index] = position
    return replace(world, positions=positions)


def test_right_poses_pass(right) -> None:
    found = check(right)
    assert found.helps
    assert found.doubts == ()
    assert not found.alone.any()
    assert found.notes(right.names) == ()
    assert (found.warped > found.unwarped + 0.2).all()


def test_poses_that_are_right_to_centimetres_pass(right) -> None:
    rng = np.random.default_rng(2)
    found = check(replace(right, positions=right.positions + rng.normal(0.0, 0.02, right.positions.shape)))
    assert found.doubts == ()
    assert not found.alone.any()


def test_two_swapped_poses_are_both_named_with_where_they_belong(right) -> None:
    found = check(moved(right, {1: POSITIONS[6], 6: POSITIONS[1]}))
    first, second = found.doubts
    assert first.startswith("reference ref_1.png is left out: its image fits x = 1.0, y = 0.0")
    assert "not x = 2, y = 1;" in first
    assert second.startswith("reference ref_6.png is left out: ")
    assert all("correct its row in poses.csv, or set observation.votes.doubted_references: keep" in one for one in found.doubts)
    assert np.flatnonzero(found.doubted).tolist() == [1, 6]
    assert found.notes(right.names) == found.doubts


@pytest.mark.slow
def test_of_many_places_those_around_the_references_most_alike_are_enough(right, monkeypatch: pytest.MonkeyPatch) -> None:
    swapped = moved(right, {1: POSITIONS[6], 6: POSITIONS[1]})
    everywhere, looked_at = check(swapped), []
    monkeypatch.setattr(plausibility, "_EVERYWHERE_UP_TO", 10)
    monkeypatch.setattr(plausibility, "_MOST_ALIKE", 3)

    def seen(*given: Any) -> Any:
        looked_at.append(given[1])
        return synthetic_features(*given)

    monkeypatch.setattr(plausibility, "synthetic_features", seen)
    assert check(swapped).doubts == everywhere.doubts
    assert len(everywhere.doubts) == 2
    assert 0 < len(looked_at) < 0.9 * len(virtual_positions(POSITIONS, 1.4, SETTINGS.virtual_places))


def test_a_setting_overrules(right) -> None:
    swapped = moved(right, {1: POSITIONS[6], 6: POSITIONS[1]})
    found = check(swapped, SETTINGS.model_copy(update={"doubted_references": "keep"}))
    assert found.doubts == ()
    assert not found.alone.any()


@pytest.mark.parametrize("index", [0, 5])
def test_a_pose_one_and_a_half_metres_off_is_named(right, index: int) -> None:
    found = check(moved(right, {index: POSITIONS[index] + [1.2, 0.9]}))
    assert [doubt.split(" is ")[0] for doubt in found.doubts] == [f"reference ref_{index}.png"]


def test_a_wrong_heading_is_named_with_the_right_one(right) -> None:
    pixels = right.pixels.copy()
    # Turned by 30 degrees: what was given is 30 degrees too little.
    pixels[7] = np.roll(pixels[7], -15, axis=1)
    (doubt,) = check(replace(right, pixels=pixels)).doubts
    assert doubt.startswith("reference ref_7.png is left out: ")
    assert "theta -30 degrees from what is given" in doubt


@pytest.mark.slow
def test_it_does_not_depend_on_the_threads(right) -> None:
    one, other = (check(moved(right, {4: (3.2, 2.4)}), threads=threads) for threads in (1, 3))
    assert np.array_equal(one.warped, other.warped)
    assert np.array_equal(one.unwarped, other.unwarped)
    assert one.doubts == other.doubts


def with_a_stranger(right: ReferencePanoramas, position=(1.5, 1.5)) -> ReferencePanoramas:
    """One more reference, of somewhere else altogether: as if walls stood around it."""
    return replace(
        right,
        pixels=np.concatenate([right.pixels, [texture(5, 72, 180)]]),
        positions=np.concatenate([right.positions, [position]]),
        names=(*right.names, "stranger.png"),
    )


def test_a_reference_behind_walls_is_no_fault_and_has_no_virtual_places(right) -> None:
    world = with_a_stranger(right)
    found = check(world)
    assert found.doubts == ()
    assert np.flatnonzero(found.alone).tolist() == [12]
    (note,) = found.notes(world.names)
    assert note.startswith("no virtual places around stranger.png: ")
    assert "poses.csv" in note
    synthesizer = ViewSynthesizer(world, np.ones((13, 180)), 0.6, found.alone)
    places = places_of(synthesizer, 1.0, SETTINGS.virtual_places)
    without = places_of(ViewSynthesizer(right, np.ones((12, 180)), 0.6), 1.0, SETTINGS.virtual_places)
    # It is a place itself, and nobody's source.
    assert places[-1] == pytest.approx([1.5, 1.5])
    assert len(places) == len(without)  # one of the grid lay there
    assert 12 not in synthesizer.sources_around(np.array([1.5, 1.5]), 13)[1]


def test_a_reference_far_from_all_others_stands_alone(right) -> None:
    found = check(moved(right, {0: (-60.0, 5.0)}))
    assert np.isnan(found.warped[0])
    assert np.flatnonzero(found.alone).tolist() == [0]
    # Its image says where it belongs.
    (doubt,) = found.doubts
    assert doubt.startswith("reference ref_0.png is left out: ")
    stranger = check(with_a_stranger(right, (-60.0, 5.0)))
    assert stranger.doubts == ()
    assert stranger.alone[12]


def test_references_that_have_nothing_in_common_give_no_virtual_places() -> None:
    world = replace(references([texture(seed) for seed in range(6)], grid(3, 2)), camera_height_m=0.6)
    found = check(world, VotesSettings())
    assert not found.helps
    assert found.doubts == ()
    (note,) = found.notes(world.names)
    assert note.startswith("no virtual places: ")
    model = VotesModel.build(world, VotesSettings())
    assert model.notes == (note,)
    assert np.array_equal(model.places.positions, world.positions)


@pytest.mark.slow
def test_a_map_does_without_wrong_poses_and_keeps_a_stranger(right) -> None:
    settings = SETTINGS.model_copy(update={"components": 20})
    swapped = moved(right, {1: POSITIONS[6], 6: POSITIONS[1]})
    model = VotesModel.build(swapped, settings)
    assert len(model.notes) == 2
    assert model.arrays()["used"].tolist() == [0, 2, 3, 4, 5, 7, 8, 9, 10, 11]
    restored = VotesModel.restore(swapped, settings, model.arrays())
    for index in (1, 6):
        # The image is found where it was taken.
        fields = [each.observe(right.panorama(index)) for each in (model, restored)]
        assert np.array_equal(fields[0].votes, fields[1].votes)
        assert np.hypot(*(fields[0].best_pose[:2] - POSITIONS[index])) < 0.15
    world = with_a_stranger(right, (9.0, 9.0))
    model = VotesModel.build(world, settings)
    assert "stranger.png" in model.notes[0]
    restored = VotesModel.restore(world, settings, model.arrays())
    assert np.array_equal(restored.places.positions, model.places.positions)
    image = world.panorama(12)
    fields = [each.observe(image) for each in (model, restored)]
    assert np.array_equal(fields[0].votes, fields[1].votes)
    assert fields[0].peak.place == len(model.places) - 1
