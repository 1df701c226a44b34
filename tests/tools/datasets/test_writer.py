from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.datasets import Dataset, DatasetWriter, Trajectory, copy_dataset, read_dataset, read_image

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), heading_column=3.0, height_m=0.4)
OTHER = PanoramaCamera(elevation_deg=(-20.0, 25.0), columns="counterclockwise")
RNG = np.random.default_rng(0)


def pictures(count: int, width: int = 12) -> list[np.ndarray]:
    return list(RNG.integers(0, 255, (count, 6, width), dtype=np.uint8))


def assert_same(one: Dataset, two: Dataset) -> None:
    assert (one.name, one.description, one.licence, one.camera) == (two.name, two.description, two.licence, two.camera)
    assert np.array_equal(one.references.poses, two.references.poses)
    assert list(one.sequences) == list(two.sequences)
    parts: list[tuple[Any, Any]] = [(one.references, two.references)]
    for a, b in [*parts, *zip(one.sequences.values(), two.sequences.values(), strict=True)]:
        assert a.camera == b.camera
        assert [f.relative_to(a.path) for f in a.files] == [f.relative_to(b.path) for f in b.files]
        assert all(np.array_equal(read_image(f), read_image(g)) for f, g in zip(a.files, b.files, strict=True))
    for a, b in zip(one.sequences.values(), two.sequences.values(), strict=True):
        assert np.array_equal(a.times, b.times)
        for p, q in ((a.odometry, b.odometry), (a.groundtruth, b.groundtruth)):
            assert (p is None) == (q is None)
            if p is not None and q is not None:
                assert np.array_equal(p.times, q.times)
                assert np.allclose(p.poses, q.poses, atol=1e-9)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    images, poses = pictures(4), RNG.uniform(-3.0, 3.0, (4, 3))
    times = 1.7e9 + np.array([0.0, 0.123456, 2.0])
    odometry = Trajectory(times + 0.01, RNG.uniform(-3.0, 3.0, (3, 3)))
    writer = DatasetWriter(tmp_path / "d", "käse", CAMERA, "a: description\nin two lines", "CC0-1.0")
    writer.add_references(iter(images), poses)
    writer.add_sequence("a_00", times, pictures(3), odometry)
    writer.add_sequence("b_00", times, pictures(3, 20), groundtruth=odometry, camera=OTHER)
    assert not (tmp_path / "d" / "dataset.yaml").exists()
    dataset = read_dataset(writer.finish())
    assert (dataset.name, dataset.description, dataset.camera) == ("käse", "a: description\nin two lines", CAMERA)
    assert np.array_equal(dataset.references.poses, poses)
    assert all(np.array_equal(read_image(f), i) for f, i in zip(dataset.references.files, images, strict=True))
    assert np.array_equal(dataset.sequences["a_00"].times, times)
    assert dataset.sequences["a_00"].groundtruth is None
    assert dataset.sequences["b_00"].camera == OTHER
    copied = read_dataset(copy_dataset(dataset, tmp_path / "copy"))
    assert_same(dataset, copied)
    assert not list(tmp_path.rglob(".*"))


def test_a_rendered_dataset_survives_copying(room: Path, tmp_path: Path) -> None:
    dataset = read_dataset(room)
    assert_same(dataset, read_dataset(copy_dataset(dataset, tmp_path / "copy")))


def test_a_full_folder_is_left_alone(room: Path) -> None:
    with pytest.raises(DatasetError, match="already exists"):
        DatasetWriter(room, "x", CAMERA)
    with pytest.raises(DatasetError, match="already exists"):
        copy_dataset(read_dataset(room), room)


@pytest.mark.parametrize("count", [1, 3])
def test_as_many_images_as_rows(tmp_path: Path, count: int) -> None:
    with pytest.raises(DatasetError, match="as many of each"):
        DatasetWriter(tmp_path / "d", "x", CAMERA).add_references(pictures(count), np.zeros((2, 3)))


@pytest.mark.parametrize("name", ["a/b", "..", ".hidden", ""])
def test_sequence_names_are_folder_names(tmp_path: Path, name: str) -> None:
    with pytest.raises(DatasetError, match="no folder name"):
        DatasetWriter(tmp_path / "d", "x", CAMERA).add_sequence(name, [1.0], pictures(1))


def test_how_well_references_are_known_is_written_and_copied(tmp_path: Path) -> None:
    writer = DatasetWriter(tmp_path / "data", "room", CAMERA)
    sds = np.array([[0.02, np.nan], [0.1, 0.03]])
    writer.add_references(pictures(2), [[0.0, 0.0, 0.0], [1.0, 0.5, 0.1]], sds=sds)
    read = read_dataset(writer.finish())
    assert read.references.sds is not None
    np.testing.assert_array_equal(read.references.sds, sds)
    copied = read_dataset(copy_dataset(read, tmp_path / "copy"))
    assert copied.references.sds is not None
    np.testing.assert_array_equal(copied.references.sds, sds)
