"""Every layout gives the drive that was written in it, to the last bit where its images are lossless."""

import shutil
from pathlib import Path

import av
import numpy as np
import pytest
from bag_writer import Messages, entries, write_ros1, write_ros2
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as RosWriter

from panoloc_mcl.robot.errors import DatasetError, ImageError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.config.recording import RecordingSettings
from panoloc_mcl.tools.datasets import Dataset, Sequence, read_dataset
from panoloc_mcl.tools.datasets.from_drive import references_from
from panoloc_mcl.tools.datasets.recordings import read_recording, sequence_of


@pytest.fixture(scope="module")
def drive(small_room: Dataset) -> Sequence:
    return small_room.sequences["noon_00"]


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


BAGS = {
    "ros1.bag": lambda path, drive: write_ros1(path, entries(drive, Messages(True)), Messages(True)),
    "ros1_lz4.bag": lambda path, drive: write_ros1(path, entries(drive, Messages(True)), Messages(True), "lz4"),
    "ros2": lambda path, drive: write_ros2(path, entries(drive, Messages(False)), Messages(False)),
    "ros2_tf": lambda path, drive: write_ros2(path, entries(drive, Messages(False), by_tf=True), Messages(False)),
    "ros2_mcap": lambda path, drive: write_ros2(path, entries(drive, Messages(False)), Messages(False), "mcap"),
    "ros2_zstd_message": lambda path, drive: write_ros2(path, entries(drive, Messages(False)), Messages(False), zstd="message"),
    "ros2_zstd_file": lambda path, drive: write_ros2(path, entries(drive, Messages(False)), Messages(False), zstd="file"),
    "ros2_png": lambda path, drive: write_ros2(path, entries(drive, Messages(False), ".png"), Messages(False), "mcap"),
}


@pytest.mark.parametrize("name", BAGS)
def test_bags(name: str, drive: Sequence, tmp_path: Path) -> None:
    path = BAGS[name](tmp_path / name, drive)
    assert_same(sequence_of(path, camera=drive.camera), drive)


def test_plain_mcap_and_database_files(drive: Sequence, tmp_path: Path) -> None:
    for storage, ending in (("mcap", ".mcap"), ("sqlite3", ".db3")):
        folder = write_ros2(tmp_path / storage, entries(drive, Messages(False)), Messages(False), storage)
        assert_same(sequence_of(next(folder.glob(f"*{ending}")), camera=drive.camera), drive)


def test_cold(drive: Sequence, tmp_path: Path) -> None:
    folder = tmp_path / "seq1_cloudy1"
    (folder / "omni_cam").mkdir(parents=True)
    (folder / "odom_scans").mkdir()
    stamps = np.rint(drive.times * 1e6).astype(np.int64)
    for stamp, pose, file in zip(stamps.tolist(), drive.groundtruth.at(drive.times).tolist(), drive.files, strict=True):
        name = f"t{stamp // 10**6}.{stamp % 10**6:06d}_x{pose[0]:.6f}_y{pose[1]:.6f}_a{pose[2]:.6f}.png"
        shutil.copy(file, folder / "omni_cam" / name)
    lines = []
    for time, (x, y, a) in zip(drive.odometry.times.tolist(), drive.odometry.poses.tolist(), strict=True):
        micros = round(time * 1e6)
        lines.append(f"#ODOM 1 {micros // 10**6} {micros % 10**6} a b c {x!r} {y!r} 0 {a!r} 0 0")
    (folder / "odom_scans" / "odom.tdf").write_text("\n".join(["# header", *lines]))
    found = sequence_of(folder, camera=drive.camera)
    assert found.times == pytest.approx(drive.times, abs=1e-6)
    assert found.odometry.poses == pytest.approx(drive.odometry.poses)
    assert found.groundtruth.poses == pytest.approx(drive.groundtruth.at(drive.times), abs=1e-6)
    assert np.array_equal(read_image(found.files[2]), read_image(drive.files[2]))


def write_video(path: Path, drive: Sequence) -> Path:
    images = [read_image(file) for file in drive.files]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        grey = images[0].ndim == 2
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "gray" if grey else "bgr0"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray" if grey else "bgr24")))
        container.mux(stream.encode())
    rows = [line.split(",") for line in (drive.path / "frames.csv").read_text().splitlines()]
    column = rows[0].index("timestamp")
    (path.parent / f"{path.stem}.frames.csv").write_text("\n".join(row[column] for row in rows))
    for part in ("odometry", "groundtruth"):
        shutil.copy(drive.path / f"{part}.tum", path.parent / f"{path.stem}.{part}.tum")
    return path


def test_a_video_with_tables_beside_it(drive: Sequence, tmp_path: Path) -> None:
    found = sequence_of(write_video(tmp_path / "drive.mkv", drive), camera=drive.camera)
    assert_same(found, drive)
    odometry = zip(drive.odometry.times.tolist(), drive.odometry.poses.tolist(), strict=True)
    rows = ["time,x,y,yaw", *(f"{t!r},{x!r},{y!r},{a!r}" for t, (x, y, a) in odometry)]
    (tmp_path / "drive.odometry.tum").unlink()
    (tmp_path / "drive.csv").write_text("\n".join(rows))
    assert same_track(read_recording(tmp_path / "drive.mkv").odometry, drive.odometry)


def test_a_folder_of_images_named_by_time(drive: Sequence, tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    (folder / "images").mkdir(parents=True)
    rows = [line.split(",") for line in (drive.path / "frames.csv").read_text().splitlines()]
    for row, file in zip(rows[1:], drive.files, strict=True):
        shutil.copy(file, folder / "images" / f"{row[rows[0].index('timestamp')]}{file.suffix}")
    for part in ("odometry", "groundtruth"):
        shutil.copy(drive.path / f"{part}.tum", folder / f"{part}.tum")
    assert_same(sequence_of(folder, camera=drive.camera), drive)


def many_chunks(path: Path, drive: Sequence, ros1: bool) -> Path:

    ros = Messages(ros1)
    found = list(entries(drive, ros))
    if ros1:
        with RosWriter(path) as writer:
            writer.chunk_threshold = 1 << 12
            kinds = {topic: kind for _, topic, kind, _ in found}
            topics = {topic: writer.add_connection(topic, kind, typestore=ros.store) for topic, kind in kinds.items()}
            for stamp, topic, kind, message in found:
                writer.write(topics[topic], stamp, ros.store.serialize_ros1(message, kind))
        return path
    with path.open("wb") as stream:
        writer2 = Writer(stream, chunk_size=1 << 12)
        writer2.start(profile="ros2")
        channels: dict[str, int] = {}
        for stamp, topic, kind, message in found:
            if topic not in channels:
                definition, _ = ros.store.generate_msgdef(kind, ros_version=2)
                schema = writer2.register_schema(name=kind, encoding="ros2msg", data=definition.encode())
                channels[topic] = writer2.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
            raw = bytes(ros.store.serialize_cdr(message, kind))
            writer2.add_message(channels[topic], log_time=stamp, publish_time=stamp, data=raw)
        writer2.finish()
    return path


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
    pixels = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (7, 9, channels)).astype(dtype)
    pixels = pixels[..., 0] if channels == 1 else pixels
    sent = pixels[..., ::-1] if encoding.startswith("rgb") else pixels
    found = [(1, "/image", "sensor_msgs/msg/Image", ros.image(10**9, np.ascontiguousarray(sent), encoding))]
    sequence = sequence_of(write_ros2(tmp_path / "bag", iter(found), ros), camera=drive.camera)
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
    sequence = sequence_of(write_ros2(tmp_path / "bag", iter(found), ros), camera=drive.camera)
    assert read_image(sequence.files[0])[4, 4].tolist() == [50, 100, 200]


def bag_of(tmp_path: Path, *found) -> Path:
    ros = Messages(False)
    return write_ros2(
        tmp_path / "bag", iter([(n + 1, topic, kind, make(ros)) for n, (topic, kind, make) in enumerate(found)]), ros
    )


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

    path = BAGS["ros2"](tmp_path / "walk", drive)
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
