"""Bags that were cut off, and what else is wrong with recordings that people have: what is whole is used, the rest is said."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.laboratory.layouts.bags import Messages, entries, save_ros2, write_mcap, write_ros1, write_ros2
from panoloc_mcl.robot.camera import to_mapping
from panoloc_mcl.robot.errors import DatasetError, PanolocError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.settings.validation import dump_yaml
from panoloc_mcl.tools.cli.main import main
from panoloc_mcl.tools.datasets import Sequence
from panoloc_mcl.tools.datasets.recordings import recordings_in, sequence_of


def cut(file: Path, part: float) -> None:
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * part)])


def assert_part_of(found: Sequence, drive: Sequence) -> None:
    assert "was cut off; what is whole in it is used" in " ".join(found.notes)
    assert 2 <= len(found) < len(drive)
    assert np.array_equal(found.times, drive.times[: len(found)])
    assert found.odometry is not None
    assert len(found.odometry) > 0
    for index in (len(found) - 1, 0, 1):
        assert np.array_equal(read_image(found.files[index]), read_image(drive.files[index]))


@pytest.mark.parametrize("zstd", [None, "message"])
@pytest.mark.parametrize("whole_folder", [True, False])
def test_half_a_database(zstd: str | None, whole_folder: bool, drive: Sequence, tmp_path: Path) -> None:
    folder = write_ros2(drive, tmp_path / "bag", zstd=zstd)
    file = next(folder.glob("*.db3"))
    cut(file, 0.6)
    assert_part_of(sequence_of(folder if whole_folder else file, camera=drive.camera), drive)


def test_a_folder_whose_mcap_was_cut_off(drive: Sequence, tmp_path: Path) -> None:
    folder = write_ros2(drive, tmp_path / "bag", storage="mcap")
    file = next(folder.glob("*.mcap"))
    # In one chunk there is nothing whole: this one has many.
    ros = Messages(ros1=False)
    from panoloc_mcl.laboratory.layouts.bags import save_mcap

    save_mcap(file, entries(drive, ros), ros, chunk=1 << 12)
    cut(file, 0.6)
    assert_part_of(sequence_of(folder, camera=drive.camera), drive)


def test_a_recorder_that_died_left_no_metadata(drive: Sequence, tmp_path: Path) -> None:
    folder = write_ros2(drive, tmp_path / "bags" / "walk")
    (folder / "metadata.yaml").unlink()
    assert [path.name for path in recordings_in(folder)] == ["walk.db3"]
    assert len(sequence_of(folder / "walk.db3", camera=drive.camera)) == len(drive)


def test_a_compressed_file_that_was_cut_off_is_refused_in_one_line(drive: Sequence, tmp_path: Path) -> None:
    folder = write_ros2(drive, tmp_path / "bag", zstd="file")
    cut(next(folder.glob("*.zstd")), 0.6)
    with pytest.raises(DatasetError, match="not a bag that can be read") as caught:
        sequence_of(folder, camera=drive.camera)
    assert len(caught.value.faults) == 1


def said(capsys) -> str:
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith(("note", "["))]
    assert len(lines) == 1
    return lines[0]


@pytest.fixture
def beside(drive: Sequence, tmp_path: Path) -> Path:
    (tmp_path / "camera.yaml").write_text(dump_yaml(to_mapping(drive.camera)))
    return tmp_path


def convert(source: Path, *more: str) -> int:
    return main(["convert", str(source), "-o", str(source.parent / "out"), *more])


def test_a_bag_without_images_is_one_line(drive: Sequence, beside: Path, capsys) -> None:
    ros = Messages(ros1=False)
    some = (entry for entry in entries(drive, ros) if "image" not in entry[1])
    assert convert(save_ros2(beside / "bag", some, ros)) == 2
    assert "bag: holds no images (topics: /odom, /truth); record the camera's topic, too" in said(capsys)


def test_two_cameras_and_none_named_is_one_line(drive: Sequence, beside: Path, capsys) -> None:
    ros, twice = Messages(ros1=False), []
    for stamp, topic, kind, message in entries(drive, ros):
        twice.append((stamp, topic, kind, message))
        if "image" in topic:
            twice.append((stamp, "/other/image", kind, message))
    bag = save_ros2(beside / "bag", twice, ros)
    assert convert(bag) == 2
    assert "several image topics, /camera/image_raw, /other/image; name one with recording.image_topic" in said(capsys)
    assert convert(bag, "--set", "recording.image_topic=/other/image") == 0


def test_a_bag_without_odometry_is_read(drive: Sequence, tmp_path: Path) -> None:
    ros = Messages(ros1=False)
    bag = save_ros2(tmp_path / "bag", (entry for entry in entries(drive, ros) if entry[1] != "/odom"), ros)
    found = sequence_of(bag, camera=drive.camera)
    assert found.odometry is None
    assert len(found) == len(drive)


@pytest.mark.parametrize("write", [write_ros1, write_mcap])
def test_nothing_of_a_damaged_start_is_taken_for_a_bag(write, drive: Sequence, tmp_path: Path) -> None:
    file = write(drive, tmp_path / "walk")
    content = bytearray(file.read_bytes())
    content[:64] = bytes(64)
    file.write_bytes(content)
    with pytest.raises(DatasetError, match="not a bag that can be read"):
        sequence_of(file, camera=drive.camera)
    shutil.rmtree(tmp_path / "walk", ignore_errors=True)


def test_a_topic_of_a_type_that_cannot_be_read_is_left_out(drive: Sequence, tmp_path: Path) -> None:
    """As rosbag2 writes events of services, whose definition is that of the service."""
    from mcap.writer import Writer

    ros, path = Messages(ros1=False), tmp_path / "walk.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for stamp, topic, kind, message in entries(drive, ros):
            if topic not in channels:
                text = ros.store.generate_msgdef(kind, ros_version=2)[0].encode()
                schema = writer.register_schema(name=kind, encoding="ros2msg", data=text)
                channels[topic] = writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
            writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, data=ros.raw(message, kind))
        schema = writer.register_schema(
            "example_interfaces/srv/AddTwoInts_Event", "ros2msg", b"int64 a\nint64 b\n---\nint64 sum\n"
        )
        events = writer.register_channel("/add/_service_event", "cdr", schema)
        writer.add_message(events, log_time=stamp, publish_time=stamp, data=b"\x00\x01\x00\x00")
        writer.finish()
    found = sequence_of(path, camera=drive.camera)
    assert "types of /add/_service_event cannot be read; left out" in " ".join(found.notes)
    assert len(found) == len(drive)
    assert found.odometry is not None
    assert drive.odometry is not None
    assert len(found.odometry) == len(drive.odometry)
    assert np.array_equal(read_image(found.files[3]), read_image(drive.files[3]))


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        ("sensor_msgs/msg/Image", "uint32 height"),
        ("sensor_msgs/msg/Image", "uint8[] data"),
        ("nav_msgs/msg/Odometry", "std_msgs/Header header"),
    ],
)
def test_definitions_of_types_without_a_field_are_no_traceback(kind: str, line: str, drive: Sequence, tmp_path: Path) -> None:
    """The definition in the bag has another name for a field, as one damaged byte makes it."""
    file = write_mcap(drive, tmp_path / "walk", compression="none")
    content, name = file.read_bytes(), line.split()[-1]
    # The last one: the summary at the end is what types are read from, and no checksum is asked for there.
    start = content.rfind(kind.encode())
    at = content.find(line.encode(), start)
    assert start < at
    at += len(line) - len(name)
    file.write_bytes(content[:at] + b"q" * len(name) + content[at + len(name) :])
    if kind == "nav_msgs/msg/Odometry":
        found = sequence_of(file, camera=drive.camera)
        assert found.odometry is None
        assert np.array_equal(read_image(found.files[0]), read_image(drive.files[0]))
        return
    with pytest.raises(PanolocError) as refused:
        read_image(sequence_of(file, camera=drive.camera).files[0])
    assert all("\n" not in fault for fault in refused.value.faults)
