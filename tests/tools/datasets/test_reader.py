from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot.camera import OmniCamera, PanoramaCamera
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.tools.datasets import check_dataset, copy_dataset, read_dataset, write_image

SHARED = Path(__file__).parents[4] / "shared" / "data"
SEQUENCE = "sequences/noon_00"


def replace(name: str, old: str, new: str) -> Callable[[Path], None]:
    def damage(room: Path) -> None:
        text = (room / name).read_text()
        assert old in text
        (room / name).write_text(text.replace(old, new, 1))

    return damage


def written(name: str, text: str) -> Callable[[Path], None]:
    def damage(room: Path) -> None:
        (room / name).write_text(text)

    return damage


def image(name: str, width: int) -> Callable[[Path], None]:
    return lambda room: write_image(room / name, np.zeros((30, width), dtype=np.uint8))


def wider_sequence(room: Path) -> None:
    for file in (room / SEQUENCE / "images").iterdir():
        write_image(file, np.zeros((30, 80), dtype=np.uint8))


def swapped_rows(room: Path) -> None:
    path = room / SEQUENCE / "frames.csv"
    head, first, second, *rest = path.read_text().splitlines()
    path.write_text("\n".join([head, second, first, *rest]))


def one_folder_down(room: Path) -> None:
    (room / "references" / "images").mkdir()
    (room / "references" / "ref_001.png").rename(room / "references" / "images" / "ref_001.png")


FAULTS: list[tuple[Callable[[Path], None], str, list[str]]] = [
    (lambda room: (room / "dataset.yaml").unlink(), "dataset.yaml", ["no such file"]),
    (replace("dataset.yaml", "panoloc-dataset/1", "panoloc-dataset/9"), "dataset.yaml", ["format", "panoloc-dataset/1"]),
    (replace("dataset.yaml", "licence:", "license:"), "dataset.yaml", ["unknown key 'license'", "'licence'"]),
    (
        replace("dataset.yaml", "columns: clockwise", "columns: left"),
        "dataset.yaml",
        ["camera.columns = 'left'", "'clockwise'"],
    ),
    (
        replace("dataset.yaml", "columns: clockwise", "columns: anticlockwise"),
        "dataset.yaml",
        ["'anticlockwise'", "did you mean 'counterclockwise'?"],
    ),
    (replace("references/poses.csv", ",y", ""), "poses.csv:1", ["column 'y' is missing", "file,x,y (theta,"]),
    (replace("references/poses.csv", "theta", "Thetta"), "poses.csv:1", ["unknown column 'Thetta'", "did you mean 'theta'?"]),
    (written("references/poses.csv", "ref_000.png,0,0,0\n"), "poses.csv:1", ["names no columns that are known", "file,x,y"]),
    (replace("references/poses.csv", "theta", "theta,z"), "poses.csv:1", ["unknown column 'z'"]),
    (
        written("references/poses.csv", "file;x;y;theta\nref_000.png;0,5;0;0\n"),
        "poses.csv:1",
        ["separated by semicolons", "commas"],
    ),
    (written("references/poses.csv", "file\tx\ty\ttheta\n"), "poses.csv:1", ["separated by tabs"]),
    (replace("references/poses.csv", "1.0,0.0,0.0", "nan,0.0,0.0"), "poses.csv:3", ["x = nan", "mend or drop"]),
    (replace("references/poses.csv", "1.0,0.0,0.0", "one,0.0,0.0"), "poses.csv:3", ["x = 'one' is not a number"]),
    (replace("references/poses.csv", "1.0,0.0,0.0", "1.0,0.0"), "poses.csv:3", ["3 values; must be 4"]),
    (
        written("references/poses.csv", "file,x,y,theta,sd_xy\nref_000.png,0,0,0,-1\n"),
        "poses.csv:2",
        ["sd_xy = -1", "above 0"],
    ),
    (replace("references/poses.csv", "ref_001", "ref_000"), "poses.csv:3", ["ref_000.png is already in line 2", "keep one"]),
    (replace("references/poses.csv", "ref_001", "ref_009"), "poses.csv:3", ["ref_009.png: no such file", "drop this row"]),
    (one_folder_down, "poses.csv:3", ["ref_001.png: no such file", "write images/ref_001.png"]),
    (lambda room: (room / "references/poses.csv").unlink(), "references/poses.csv", ["no such file", "file, x, y, theta"]),
    (written("references/poses.csv", "file,x,y,theta\n"), "poses.csv", ["holds no rows"]),
    (swapped_rows, "frames.csv:3", ["timestamp", "does not increase"]),
    (replace(f"{SEQUENCE}/groundtruth.tum", " 0.000000000 ", " nan "), "groundtruth.tum:2", ["nan is not finite"]),
    (replace(f"{SEQUENCE}/odometry.tum", "1.000000000000", "2.000000000000"), "odometry.tum:2", ["quaternion", "normalise"]),
    (image("references/ref_001.png", 71), "ref_001.png", ["71 x 30", "72 x 30", "resize or drop"]),
    (wider_sequence, "noon_00", ["80 x 30", "72 x 30", "add a camera.yaml"]),
    (
        written(f"{SEQUENCE}/camera.yaml", "kind: fisheye\n"),
        "camera.yaml",
        ["kind = 'fisheye'"],
    ),
    (written("references/ref_002.png", "no image"), "ref_002.png", ["PNG or JPEG"]),
]


@pytest.mark.parametrize(("damage", "where", "words"), FAULTS)
def test_a_fault_is_one_line_with_place_value_and_remedy(
    room: Path, damage: Callable[[Path], None], where: str, words: list[str]
) -> None:
    damage(room)
    with pytest.raises(DatasetError) as caught:
        read_dataset(room)
    (fault,) = caught.value.faults
    assert fault.startswith(str(room))
    assert where in fault
    assert all(word in fault for word in words), fault
    assert check_dataset(room)[0] == fault


@pytest.mark.parametrize("name", ["a" * 300 + ".png", "..", ".", "images"])
def test_what_no_image_can_be_called_is_looked_for_nowhere_else(room: Path, name: str) -> None:
    (room / "references" / "images").mkdir()
    replace("references/poses.csv", "ref_001.png", name)(room)
    (fault,) = check_dataset(room)
    assert fault.endswith("add the image, or drop this row")


def test_every_fault_is_reported_at_once(room: Path) -> None:
    replace("dataset.yaml", "clockwise", "left")(room)
    replace("references/poses.csv", "1.0,", "nan,")(room)
    replace(f"{SEQUENCE}/odometry.tum", "1.000000000000", "x")(room)
    replace(f"{SEQUENCE}/frames.csv", "file", "image")(room)
    with pytest.raises(DatasetError) as caught:
        read_dataset(room)
    assert len(caught.value.faults) == 5  # a column renamed is one missing and one unknown


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such folder"):
        read_dataset(tmp_path / "none")
    assert len(check_dataset(tmp_path / "none")) == 1


def test_a_folder_of_something_else(tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").write_bytes(b"")
    (fault,) = check_dataset(tmp_path)
    assert fault.startswith(f"{tmp_path}: neither a data set (it holds no dataset.yaml) nor a recording (")
    assert "odometry.tum" in fault


def test_a_good_dataset(room: Path) -> None:
    assert check_dataset(room) == []
    dataset = read_dataset(room)
    assert (dataset.name, dataset.licence, dataset.path) == ("room", "CC0-1.0", room)
    assert isinstance(dataset.camera, PanoramaCamera)
    assert np.array_equal(dataset.references.poses, [[0, 0, 0], [1, 0, 0], [3, 2, 0]])
    assert dataset.references.image_size == (72, 30)
    sequence = dataset.sequences["noon_00"]
    assert len(sequence) == 3
    assert sequence.groundtruth is not None
    assert np.allclose(sequence.groundtruth.times, sequence.times)


def test_optional_parts_may_be_missing(room: Path) -> None:
    (room / SEQUENCE / "odometry.tum").unlink()
    (room / SEQUENCE / "groundtruth.tum").unlink()
    sequence = read_dataset(room).sequences["noon_00"]
    assert sequence.odometry is None
    assert sequence.groundtruth is None
    assert check_dataset(room) == []
    import shutil

    shutil.rmtree(room / "sequences")
    assert read_dataset(room).sequences == {}


def test_a_folder_may_have_its_own_camera(room: Path) -> None:
    wider_sequence(room)
    (room / SEQUENCE / "camera.yaml").write_text("{kind: panorama, columns: counterclockwise, elevation_deg: [-40, 40]}")
    dataset = read_dataset(room)
    sequence = dataset.sequences["noon_00"]
    assert sequence.image_size == (80, 30)
    assert sequence.camera != dataset.camera


def test_columns_in_any_order_and_a_byte_order_mark(room: Path) -> None:
    (room / "references/poses.csv").write_text("\ufefftheta, file, y, x\n0.5, ref_000.png, 2, 1\n\n", encoding="utf-8")
    assert np.array_equal(read_dataset(room).references.poses, [[1.0, 2.0, 0.5]])


@pytest.mark.parametrize("file", ["references/poses.csv", f"{SEQUENCE}/frames.csv", f"{SEQUENCE}/odometry.tum"])
def test_another_encoding_is_told_with_its_line(room: Path, file: str) -> None:
    (room / file).write_bytes((room / file).read_bytes() + "# caf\u00e9\n".encode("latin-1"))
    line = (room / file).read_bytes().count(b"\n")
    with pytest.raises(DatasetError, match=rf"{file}:{line}: byte 0xe9 is not UTF-8; save the file"):
        read_dataset(room)


def test_standard_deviations_of_poses_are_optional(room: Path) -> None:
    assert read_dataset(room).references.sds is None
    table = "file,x,y,theta,sd_theta,sd_xy\nref_000.png,0,0,0,0.1,0.02\nref_001.png,1,0,0,,0.05\n"
    (room / "references/poses.csv").write_text(table)
    sds = read_dataset(room).references.sds
    assert sds is not None
    np.testing.assert_array_equal(sds, [[0.02, 0.1], [0.05, np.nan]])


@pytest.mark.parametrize("table", ["file,x,y\nref_000.png,1,2\n", "file,x,y,theta,sd_theta\nref_000.png,1,2,,\n"])
def test_headings_may_be_missing(room: Path, table: str) -> None:
    (room / "references/poses.csv").write_text(table)
    dataset = read_dataset(room)
    assert np.array_equal(dataset.references.poses, [[1.0, 2.0, 0.0]])
    assert dataset.references.sds is not None
    assert np.isinf(dataset.references.sds[0, 1])
    # And stay so where the data set is written again.
    again = read_dataset(copy_dataset(dataset, room.parent / "again")).references
    assert again.sds is not None
    assert np.isinf(again.sds[0, 1])
    assert np.array_equal(again.poses, dataset.references.poses)


def test_select(room: Path) -> None:
    for name in ("noon_01", "evening_00"):
        import shutil

        shutil.copytree(room / SEQUENCE, room / "sequences" / name)
    dataset = read_dataset(room)
    assert [s.name for s in dataset.select("all")] == ["evening_00", "noon_00", "noon_01"]
    assert [s.name for s in dataset.select(["noon_*", "noon_01"])] == ["noon_00", "noon_01"]
    with pytest.raises(DatasetError, match="'noon_0' fits none; did you mean 'noon_0") as caught:
        dataset.select(["noon_0", "xyz"])
    assert len(caught.value.faults) == 2
    assert "evening_00, noon_00, noon_01" in caught.value.faults[1]


@pytest.mark.skipif(not (SHARED / "hall_omni").is_dir(), reason="shared data not at hand")
def test_recorded_data_is_read() -> None:
    omni = read_dataset(SHARED / "hall_omni")
    assert len(omni.references) == 42
    assert isinstance(omni.references.camera, PanoramaCamera)
    assert all(isinstance(s.camera, OmniCamera) and s.image_size == (480, 480) for s in omni.sequences.values())
    assert len(read_dataset(SHARED / "office").sequences) == 3
