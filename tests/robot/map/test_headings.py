"""Headings found from images: of the small room, whose panoramas are turned by whole columns."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from oracles.furnished_room import build_room

from panoloc_mcl.robot.camera import PanoramaGeometry
from panoloc_mcl.robot.geometry import angle_difference, wrap_angle
from panoloc_mcl.robot.map.headings import with_headings
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image


@pytest.fixture(scope="module")
def near(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Twelve references of the room, as near to each other as those of a drive."""
    path = tmp_path_factory.mktemp("near") / "data"
    grid = tuple((0.3 * x + 0.02 * y, 0.35 * y + 0.5) for y in range(3) for x in range(4))
    build_room(path, frames=1, geometry=PanoramaGeometry(90, 36, -50.0, 25.0), grid=grid, lights=("noon",))
    return read_dataset(path)


@pytest.fixture(scope="module")
def turned(near: Dataset, tmp_path_factory: pytest.TempPathFactory) -> References:
    """The same as though each had been taken at another heading, which stands in its pose."""
    folder, references = tmp_path_factory.mktemp("turned"), near.references
    columns, files = references.image_size[0], []
    shifts = np.random.default_rng(0).integers(0, columns, len(references))
    for index, (file, shift) in enumerate(zip(references.files, shifts, strict=True)):
        files.append(folder / f"{index}.png")
        # Clockwise columns: what lies ahead lies to the right after a turn to the left.
        cv2.imwrite(str(files[-1]), np.roll(read_image(file), int(shift), axis=1))
    poses = references.poses.copy()
    poses[:, 2] = wrap_angle(poses[:, 2] + 2.0 * np.pi * shifts / columns)
    return replace(references, files=tuple(files), poses=poses)


def found_errors(given: References, truth: References) -> tuple[np.ndarray, tuple[str, ...], References]:
    found, notes = with_headings(given, VotesSettings(), MapSettings())
    return np.degrees(np.abs(angle_difference(found.poses[:, 2], truth.poses[:, 2]))), notes, found


def sds(count: int, heading: float) -> np.ndarray:
    return np.column_stack([np.full(count, np.nan), np.full(count, heading)])


def test_known_headings_are_left_alone(turned: References) -> None:
    found, notes = with_headings(turned, VotesSettings(), MapSettings())
    assert found is turned
    assert notes == ()


def test_coarse_headings_are_found(turned: References) -> None:
    rng = np.random.default_rng(1)
    poses = turned.poses + np.outer(rng.normal(0.0, np.radians(20.0), len(turned)), [0.0, 0.0, 1.0])
    errors, (note,), found = found_errors(replace(turned, poses=poses, sds=sds(len(turned), np.radians(20.0))), turned)
    # The mean of all is as uncertain as twelve headings of 20 degrees leave it; what is left between them is parallax.
    assert np.std(np.degrees(angle_difference(found.poses[:, 2], turned.poses[:, 2]))) < 4.0
    assert errors.max() < 15.0
    assert "headings of 12 of 12 references found from their images" in note
    assert found.sds is not None
    assert np.all(found.sds[:, 1] < np.radians(10.0))


def test_some_missing_ones_are_found_beside_the_others(turned: References) -> None:
    poses, spread = turned.poses.copy(), sds(len(turned), np.nan)
    poses[[2, 5, 7], 2], spread[[2, 5, 7], 1] = 0.0, np.inf
    errors, (note,), found = found_errors(replace(turned, poses=poses, sds=spread), turned)
    assert errors.max() < 4.0
    np.testing.assert_array_equal(np.delete(found.poses, [2, 5, 7], 0), np.delete(turned.poses, [2, 5, 7], 0))
    assert "headings of 3 of 12" in note


@pytest.mark.slow
def test_missing_headings_are_found_by_parallax_and_mended(turned: References, near: Dataset) -> None:
    poses = turned.poses * [1.0, 1.0, 0.0]
    given = replace(turned, poses=poses, sds=sds(len(turned), np.inf))
    errors, (note,), _ = found_errors(given, turned)
    assert errors.max() < 10.0
    assert "headings of 12 of 12" in note
    built = PanoramaMap.build(replace(near, references=given))
    assert note in built.notes
    off = np.degrees(np.abs(angle_difference(built.keyframes.poses[:, 2], turned.poses[:, 2])))
    assert off.max() < 1.5


def test_headings_a_metre_apart_are_found_without_a_height(small_room: Dataset) -> None:
    # In a room of four metres, in pictures of four degrees a column.
    references = small_room.references
    given = replace(references, camera=references.camera.model_copy(update={"height_m": None}))
    given = replace(given, poses=given.poses * [1.0, 1.0, 0.0], sds=sds(len(given), np.inf))
    errors, (note,), found = found_errors(given, references)
    assert errors.max() < 10.0
    assert found.sds is not None
    assert (errors < 3.0 * np.degrees(found.sds[:, 1])).all()
    assert "too few" not in note


@pytest.mark.slow
def test_headings_of_a_robot_that_stood_are_found(turned: References) -> None:
    # Eight images at each of two places: more than a reference has neighbours.
    stood = turned.of(np.array([0] * 8 + [5] * 8 + [1, 2, 3, 4, 6, 7, 8, 9, 10, 11]))
    given = replace(stood, poses=stood.poses * [1.0, 1.0, 0.0], sds=sds(len(stood), np.inf))
    errors, _, found = found_errors(given, stood)
    assert errors.max() < 10.0
    assert found.sds is not None
    assert np.isfinite(found.sds[:, 1]).all()


def test_two_alone_do_not_tell_how_both_are_turned(near: Dataset) -> None:
    two = near.references.of(np.array([0, 1]))
    _, (note,), found = found_errors(replace(two, sds=sds(2, np.inf)), two)
    assert "too few stand together to tell how all of these are turned: give theta of one of them" in note
    assert found.sds is not None
    assert np.isinf(found.sds[:, 1]).all()


def test_headings_that_cannot_be_told_are_said_to_be_so(near: Dataset, tmp_path: Path) -> None:
    rng, references, files = np.random.default_rng(5), near.references.of(np.arange(6)), []
    for index in range(len(references)):
        files.append(tmp_path / f"{index}.png")
        cv2.imwrite(str(files[-1]), rng.integers(0, 256, references.image_size[::-1], dtype=np.uint8))
    given = replace(references, files=tuple(files), sds=sds(len(references), np.inf))
    _, (note,) = with_headings(given, VotesSettings(), MapSettings())
    assert "too unlike to tell: give theta in poses.csv" in note
