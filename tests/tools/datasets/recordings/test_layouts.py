"""Every layout gives the drive that was written in it, to the last bit where its images are lossless."""

from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.laboratory.layouts import LAYOUTS
from panoloc_mcl.laboratory.layouts.bags import Messages, entries, save_mcap, save_ros1, save_ros2, write_ros1, write_ros2
from panoloc_mcl.laboratory.layouts.files import write_video
from panoloc_mcl.robot.errors import DatasetError, ImageError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.config.recording import RecordingSettings
from panoloc_mcl.tools.datasets import Dataset, Sequence, read_dataset
from panoloc_mcl.tools.datasets.recordings import read_recording, sequence_of
from panoloc_mcl.tools.datasets.references.from_drive import references_from


def same_track(one, other) -> bool:
    return np.array_equal(one.times, other.times) and np.array_equal(one.poses, other.poses)


def assert_same(found: Sequence, drive: Sequence, truth_exact: bool = True) -> None:
    assert np.array_equal(found.times, drive.times)
    assert found.image_size == drive.image_size
    assert same_track(found.odometry, drive.odometry)
    if truth_exact:
        assert same_track(found.groundtruth, drive.groundtruth)
    # Out of order, too: a look back and a jump ahead.
    for index in [*range(len(drive)), 3, 0, len(drive) - 1, 1]:
        assert np.array_equal(read_image(found.files[index]), read_image(drive.files[index]))


OTHERS = {
    "ros2_tf": lambda drive, path: write_ros2(drive, path, by_tf=True),
    "ros2_zstd_file": lambda drive, path: write_ros2(drive, path, zstd="file"),
    "ros1_bz2": lambda drive, path: write_ros1(drive, path, compression="bz2"),
}


@pytest.mark.parametrize("name", [*(name for name, layout in LAYOUTS.items() if layout.lossless), *OTHERS])
def test_a_drive_comes_out_as_it_went_in(name: str, drive: Sequence, tmp_path: Path) -> None:
    write = OTHERS[name] if name in OTHERS else LAYOUTS[name].write
    found = sequence_of(write(drive, tmp_path / "walk"), camera=drive.camera)
    assert found.name == "walk"
    # In the COLD layout the true poses are those of the images.
    assert_same(found, drive, truth_exact=name != "cold")
    assert np.array_equal(found.groundtruth.at(drive.times), drive.groundtruth.at(drive.times))


@pytest.mark.parametrize("name", [name for name, layout in LAYOUTS.items() if not layout.lossless])
def test_lossy_layouts_keep_everything_but_the_last_bits_of_images(name: str, drive: Sequence, tmp_path: Path) -> None:
    found = sequence_of(LAYOUTS[name].write(drive, tmp_path / "walk"), camera=drive.camera)
    assert np.array_equal(found.times, drive.times)
    assert same_track(found.odometry, drive.odometry)
    for mine, theirs in zip(found.files, drive.files, strict=True):
        # A video's frames are in colour where its codec has no grey.
        decoded = np.atleast_3d(read_image(mine).astype(float)).mean(axis=2)
        assert np.abs(decoded - read_image(theirs)).mean() < 6.0


def test_plain_mcap_and_database_files(drive: Sequence, tmp_path: Path) -> None:
    for storage, ending in (("mcap", ".mcap"), ("sqlite3", ".db3")):
        folder = write_ros2(drive, tmp_path / storage, storage=storage)
        assert_same(sequence_of(next(folder.glob(f"*{ending}")), camera=drive.camera), drive)


def test_a_video_may_have_its_odometry_beside_it_as_tum(drive: Sequence, tmp_path: Path) -> None:
    write_video(drive, tmp_path / "drive", odometry="tum")
    assert same_track(read_recording(tmp_path / "drive.mkv").odometry, drive.odometry)
    (tmp_path / "drive.odometry.tum").rename(tmp_path / "drive.tum")
    assert same_track(read_recording(tmp_path / "drive.mkv").odometry, drive.odometry)


def many_chunks(path: Path, drive: Sequence, ros1: bool) -> Path:
    ros = Messages(ros1)
    return (save_ros1 if ros1 else save_mcap)(path, entries(drive, ros), ros, chunk=1 << 12)


@pytest.mark.parametrize("ending", [".bag", ".mcap"])
def test_half_a_bag_gives_half_a_drive(ending: str, drive: Sequence, tmp_path: Path) -> None:
    whole = many_chunks(tmp_path / f"whole{ending}", drive, ending == ".bag")
    assert_same(sequence_of(whole, camera=drive.camera), drive)
    cut = tmp_path / f"cut{ending}"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    found = sequence_of(cut, camera=drive.camera)
    assert any("cut off" in note for note in found.notes)
    assert len(drive) // 3 <= len(found) < len(drive)
    for index in (0, len(found) - 1, 1):
        assert np.array_equal(read_image(found.files[index]), read_image(drive.files[index]))


ENCODINGS = [
    ("mono8", np.uint8, 1), ("bgr8", np.uint8, 3), ("rgb8", np.uint8, 3), ("bgra8", np.uint8, 4), ("mono16", np.uint16, 1),
    ("rgb16", np.uint16, 3), ("8UC1", np.uint8, 1), ("16UC3", np.uint16, 3),
]  # fmt: skip


@pytest.mark.parametrize(("encoding", "dtype", "channels"), ENCODINGS)
def test_encodings(encoding: str, dtype: type, channels: int, drive: Sequence, tmp_path: Path) -> None:
    ros = Messages(False)
    pixels: np.ndarray = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (7, 9, channels)).astype(dtype)
    pixels = pixels[..., 0] if channels == 1 else pixels
    sent = pixels[..., ::-1] if encoding.startswith("rgb") else pixels
    found = [(1, "/image", "sensor_msgs/msg/Image", ros.image(10**9, np.ascontiguousarray(sent), encoding))]
    sequence = sequence_of(save_ros2(tmp_path / "bag", found, ros), camera=drive.camera)
    assert np.array_equal(read_image(sequence.files[0]), pixels)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns(pattern: str, drive: Sequence, tmp_path: Path) -> None:
    """A field of one colour comes out as that colour, whatever the pattern."""
    ros = Messages(False)
    colour = {"r": 200, "g": 100, "b": 50}
    raw = np.tile(
        np.array([[colour[pattern[0]], colour[pattern[1]]], [colour[pattern[2]], colour[pattern[3]]]], np.uint8), (4, 4)
    )
    found = [(1, "/image", "sensor_msgs/msg/Image", ros.image(10**9, raw, f"bayer_{pattern}8"))]
    sequence = sequence_of(save_ros2(tmp_path / "bag", found, ros), camera=drive.camera)
    assert read_image(sequence.files[0])[4, 4].tolist() == [50, 100, 200]


def bag_of(tmp_path: Path, *found) -> Path:
    ros = Messages(False)
    return save_ros2(tmp_path / "bag", ([(n + 1, topic, kind, make(ros)) for n, (topic, kind, make) in enumerate(found)]), ros)


def image(stamp: int = 10**9, **fields):
    def make(ros: Messages):
        message = ros.image(stamp, np.full((5, 6), 7, np.uint8))
        for name, value in fields.items():
            object.__setattr__(message, name, value)
        return message

    return make


IMAGE, ODOMETRY = "sensor_msgs/msg/Image", "nav_msgs/msg/Odometry"
ROW = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("found", "settings", "said"),
    [
        ([("/odom", ODOMETRY, lambda ros: ros.odometry(1, ROW))], {}, "holds no images"),
        (
            [("/a", IMAGE, image()), ("/b", IMAGE, image())],
            {},
            "several image topics, /a, /b; name one with recording.image_topic",
        ),
        ([("/left", IMAGE, image())], {"image_topic": "/lef"}, "did you mean '/left'"),
        ([("/left", IMAGE, image())], {"image_topic": "/left", "odometry_topic": "/left"}, "must be nav_msgs/msg/Odometry"),
        ([("/a", IMAGE, image(encoding="jpg9"))], {}, "encoding 'jpg9' is unknown"),
        ([("/a", IMAGE, image(encoding="rgb8"))], {}, "are no 6 x 5 pixels of 'rgb8'"),
    ],
)
def test_what_cannot_be_read_is_said_in_one_line(found, settings, said: str, drive: Sequence, tmp_path: Path) -> None:
    path = bag_of(tmp_path, *found)
    with pytest.raises(DatasetError) as caught:
        sequence_of(path, RecordingSettings(**settings), drive.camera)
    assert said in str(caught.value)


def test_odd_messages_are_left_out_and_said(drive: Sequence, tmp_path: Path) -> None:
    nan = [float("nan"), *ROW[1:]]
    path = bag_of(
        tmp_path,
        ("/a", IMAGE, image(10**9)), ("/a", IMAGE, image(10**9)), ("/a", IMAGE, image(0)),
        ("/odom", ODOMETRY, lambda ros: ros.odometry(10**9, nan)), ("/odom", ODOMETRY, lambda ros: ros.odometry(2 * 10**9, ROW)),
        ("/a", IMAGE, image(3 * 10**9, encoding="what")),
    )  # fmt: skip
    found = sequence_of(path, camera=drive.camera)
    notes = " ".join(found.notes)
    assert "1 images have the stamp of another one" in notes
    assert "1 messages have no stamp" in notes
    assert "1 poses are doubled, not finite" in notes
    assert len(found) == 3
    assert found.odometry is not None
    assert len(found.odometry) == 1
    with pytest.raises(ImageError, match="encoding 'what' is unknown"):
        read_image(found.files[-1])


def test_nothing_that_is_a_bag(drive: Sequence, tmp_path: Path) -> None:
    for name in ("empty.bag", "text.mcap", "text.db3"):
        (tmp_path / name).write_text("" if name.startswith("empty") else "no bag at all, just words")
        with pytest.raises(DatasetError, match="not a bag that can be read"):
            sequence_of(tmp_path / name, camera=drive.camera)


def test_references_from_a_drive(drive: Sequence) -> None:
    some = references_from(drive, 0.5)
    apart = np.hypot(*(some.poses[:, None, :2] - some.poses[None, :, :2]).transpose(2, 0, 1))
    assert apart[~np.eye(len(some), dtype=bool)].min() >= 0.5
    assert len(some) > 2
    index = drive.files.index(some.files[1])
    assert np.array_equal(some.poses[1], drive.groundtruth.at(drive.times[index]))


def test_convert_writes_a_data_set(small_room: Dataset, drive: Sequence, tmp_path: Path, capsys) -> None:
    from panoloc_mcl.robot.camera import to_mapping
    from panoloc_mcl.robot.settings.validation import dump_yaml

    path = write_ros2(drive, tmp_path / "walk")
    assert main(["convert", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "nothing says which camera this is" in capsys.readouterr().err
    (tmp_path / "camera.yaml").write_text(dump_yaml(to_mapping(drive.camera)))
    words = ["convert", str(path), "-o", str(tmp_path / "out"), "--camera", str(tmp_path / "camera.yaml")]
    assert main([*words, "--set", "references={from: walk, every_m: 0.5}"]) == 0
    found = read_dataset(tmp_path / "out")
    assert len(found.references) > 2
    assert np.array_equal(found.sequences["walk"].times, drive.times)
    assert found.sequences["walk"].odometry.poses == pytest.approx(drive.odometry.poses, abs=1e-9)
    assert np.array_equal(read_image(found.sequences["walk"].files[1]), read_image(drive.files[1]))
