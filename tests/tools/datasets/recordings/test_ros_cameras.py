"""What a bag says of the camera, its place on the robot, and the truth: CameraInfo and /tf."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from panoloc_mcl.laboratory.layouts.bags import Messages, save_ros1, save_ros2
from panoloc_mcl.robot.camera.directions import pixels_of
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.tools.config.recording import RecordingSettings
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.datasets.recordings import dataset_of_recordings, sequence_of
from panoloc_mcl.tools.datasets.recordings.ros.messages import CAMERA_INFO, COMPRESSED, IMAGE, TF

S = 10**9


def info_of(ros: Messages, model: str = "equidistant", frame: str = "camera_optical_frame"):
    k = np.array([90.0, 0.0, 100.0, 0.0, 91.0, 99.0, 0.0, 0.0, 1.0])
    d = np.array([0.01, -0.002, 0.0003, 0.0])
    big = {"K": k, "D": d, "R": np.eye(3).ravel(), "P": np.zeros(12)}
    small = {name.lower(): value for name, value in big.items()}
    roi = ros.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return ros.make(
        CAMERA_INFO, header=ros.header(S, frame), height=200, width=202, distortion_model=model,
        **(big if ros.ros1 else small), binning_x=0, binning_y=0, roi=roi,
    )  # fmt: skip


def transform(ros: Messages, parent: str, child: str, xyz=(0.0, 0.0, 0.0), axes: np.ndarray | None = None, stamp: int = S):
    quaternion = Rotation.from_matrix(np.eye(3) if axes is None else axes).as_quat()
    return ros.transform(stamp, parent, child, [*xyz, *quaternion])


def bag(path: Path, ros1: bool, *found) -> Path:
    ros = Messages(ros1)
    made = [
        (number + 1, topic, kind, make(ros) if callable(make) else make) for number, (topic, kind, make) in enumerate(found)
    ]
    return save_ros1(path.with_suffix(".bag"), made, ros) if ros1 else save_ros2(path, made, ros)


def picture(frame: str = "camera_optical_frame", stamp: int = S):
    return ("/omni/image_raw", IMAGE, lambda ros: ros.image(stamp, np.full((200, 202), 9, np.uint8), frame=frame))


@pytest.mark.parametrize("ros1", [False, True])
def test_camera_info_of_a_fisheye_is_taken(ros1: bool, tmp_path: Path) -> None:
    found = sequence_of(bag(tmp_path / "bag", ros1, ("/omni/camera_info", CAMERA_INFO, info_of), picture()))
    assert found.camera.kind == "omni"
    assert (found.camera.lens.fx, found.camera.lens.cy) == (90.0, 99.0)
    assert found.camera.size_px == (202, 200)
    assert "taken to look down" in " ".join(found.notes)


def test_of_compressed_images_it_stands_one_level_higher(tmp_path: Path) -> None:
    image = (
        "/omni/image/compressed",
        COMPRESSED,
        lambda ros: ros.compressed(S, np.zeros((200, 202), np.uint8)),
    )
    found = sequence_of(bag(tmp_path / "bag", False, ("/omni/camera_info", CAMERA_INFO, info_of), image))
    assert found.camera.lens.k == pytest.approx((0.01, -0.002, 0.0003, 0.0))


# From the image's axes to the robot's: looks up, the upper edge of the image to the robot's left.
UP = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
# Looks down, the heading to the right in the image.
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


@pytest.mark.parametrize(("axes", "looks"), [(UP, "up"), (DOWN, "down")])
@pytest.mark.parametrize("tilt_deg", [0.0, 8.0])
def test_tf_says_where_the_axis_points(axes: np.ndarray, looks: str, tilt_deg: float, tmp_path: Path) -> None:
    axes = Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix() @ axes
    path = bag(
        tmp_path / "bag", False,
        ("/tf_static", TF, lambda ros: transform(ros, "base_link", "mast", (0.1, 0.0, 0.5))),
        ("/tf_static", TF, lambda ros: transform(ros, "mast", "camera_optical_frame", (0.05, -0.02, 0.1), axes)),
        ("/omni/camera_info", CAMERA_INFO, info_of), picture(),
    )  # fmt: skip
    camera = sequence_of(path).camera
    assert camera.looks == looks
    assert (camera.mount.x_m, camera.mount.y_m) == pytest.approx((0.15, -0.02))
    assert (camera.mount.yaw_deg, camera.mount.roll_deg) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert camera.mount.pitch_deg == pytest.approx(tilt_deg)
    # A ray of the robot's frame is where the lens has it, straight from the transform.
    for azimuth, elevation in ((0.0, -0.3 if looks == "down" else 0.3), (1.2, -0.5 if looks == "down" else 0.5)):
        ray = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        wanted = camera.lens.project((axes.T @ ray)[None])
        # Directions of the camera's own level frame: the mount's tilt taken off.
        own = camera.mount.rotation.T @ ray
        found = pixels_of(
            camera, (202, 200), np.array([np.arctan2(own[1], own[0])]), np.array([np.arcsin(own[2])]), bounded=False
        )
        assert np.ravel(found[0])[0] == pytest.approx(np.ravel(wanted[0])[0], abs=1e-6)
        assert np.ravel(found[1])[0] == pytest.approx(np.ravel(wanted[1])[0], abs=1e-6)


def test_a_camera_that_looks_sideways_makes_no_panorama(tmp_path: Path) -> None:
    ahead = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    path = bag(
        tmp_path / "bag", False,
        ("/tf_static", TF, lambda ros: transform(ros, "base_link", "camera_optical_frame", axes=ahead)),
        ("/omni/camera_info", CAMERA_INFO, info_of), picture(),
    )  # fmt: skip
    with pytest.raises(DatasetError, match="its axis is not vertical"):
        sequence_of(path)


def test_a_camera_that_somebody_describes_counts_more_and_the_map_s_less(small_room: Dataset, tmp_path: Path) -> None:
    path = bag(tmp_path / "bag", False, ("/omni/camera_info", CAMERA_INFO, info_of), picture())
    assert sequence_of(path, camera=small_room.camera).camera == small_room.camera
    assert dataset_of_recordings(path, None, small_room.camera).camera.kind == "omni"
    other = bag(
        tmp_path / "pinhole", False, ("/omni/camera_info", CAMERA_INFO, lambda ros: info_of(ros, "plumb_bob")), picture()
    )
    assert dataset_of_recordings(other, None, small_room.camera).camera == small_room.camera


@pytest.mark.parametrize("frame", ["camera", "camera_optical_frame"])
def test_the_mount_of_a_described_camera_comes_from_tf(frame: str, small_room: Dataset, tmp_path: Path) -> None:
    turned = Rotation.from_euler("ZYX", [30.0, 2.0, -1.0], degrees=True).as_matrix()
    optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    axes = turned @ optical if "optical" in frame else turned
    path = bag(
        tmp_path / "bag", False,
        ("/tf_static", TF, lambda ros: transform(ros, "base_footprint", frame, (0.2, -0.1, 0.6), axes)), picture(frame),
    )  # fmt: skip
    found = sequence_of(path, camera=small_room.camera)
    mount = found.camera.mount
    assert (mount.x_m, mount.y_m) == pytest.approx((0.2, -0.1))
    assert (mount.yaw_deg, mount.pitch_deg, mount.roll_deg) == pytest.approx((30.0, 2.0, -1.0), abs=1e-6)
    assert "camera at x 0.200 m, y -0.100 m, yaw 30.0 degrees, by tf" in " ".join(found.notes)
    described = small_room.camera.model_copy(update={"mount": mount.model_copy(update={"x_m": 0.0})})
    assert sequence_of(path, camera=described).camera.mount.x_m == 0.0


def test_truth_and_odometry_come_from_a_tree_of_transforms(small_room: Dataset, tmp_path: Path) -> None:
    found = [picture("base_link")]
    for second in range(1, 6):
        c, s = np.cos(0.1 * second), np.sin(0.1 * second)
        moved = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        ros = Messages(False)
        found += [
            ("/tf", TF, transform(ros, "/odom", "/base_link", (0.5 * second, 0.0, 0.0), moved, second * S)),
            ("/tf", TF, transform(ros, "map", "odom", (3.0, 1.0, 0.0), quarter, second * S)),
        ]
    drive = sequence_of(bag(tmp_path / "bag", False, *found), camera=small_room.camera)
    assert drive.odometry.poses[-1] == pytest.approx([2.5, 0.0, 0.5])
    assert drive.groundtruth.poses[-1] == pytest.approx([3.0, 1.0 + 2.5, 0.5 + np.pi / 2])
    renamed = RecordingSettings(map_frame="world")
    assert sequence_of(tmp_path / "bag", renamed, small_room.camera).groundtruth is None


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("big", [0, 1])
def test_bayer_patterns_of_16_bits_in_either_order_of_bytes(
    pattern: str, big: int, small_room: Dataset, tmp_path: Path
) -> None:
    colour = {"r": 40_000, "g": 20_000, "b": 300}
    cell = np.array([[colour[c] for c in pattern[:2]], [colour[c] for c in pattern[2:]]], dtype=np.uint16)
    raw = np.tile(cell, (5, 6)).astype(">u2" if big else "<u2")

    def make(ros: Messages):
        message = ros.image(S, raw, f"bayer_{pattern}16")
        object.__setattr__(message, "is_bigendian", big)
        return message

    found = sequence_of(bag(tmp_path / "bag", False, ("/image", IMAGE, make)), camera=small_room.camera)
    pixels = read_image(found.files[0])
    assert pixels.dtype == np.uint16
    assert pixels[4, 6].tolist() == [300, 20_000, 40_000]


def test_rows_may_be_padded_and_16_bits_grey(small_room: Dataset, tmp_path: Path) -> None:
    pixels = np.random.default_rng(3).integers(0, 2**16, (5, 7)).astype(np.uint16)
    padded = np.hstack([pixels, np.full((5, 1), 77, np.uint16)])

    def make(ros: Messages):
        message = ros.image(S, padded, "mono16")
        object.__setattr__(message, "width", 7)
        return message

    found = sequence_of(bag(tmp_path / "bag", False, ("/image", IMAGE, make)), camera=small_room.camera)
    assert np.array_equal(read_image(found.files[0]), pixels)


def test_yuv_of_a_grey_world_is_grey(small_room: Dataset, tmp_path: Path) -> None:
    for name, first in (("uyvy", 128), ("yuyv", 120)):
        raw = np.empty((4, 6, 2), np.uint8)
        raw[..., 0], raw[..., 1] = (128, 120) if name == "uyvy" else (120, 128)
        assert raw[0, 0, 0] == first

        def make(ros: Messages, raw=raw, name=name):
            message = ros.image(S, raw.reshape(4, 12), name)
            object.__setattr__(message, "width", 6)
            return message

        found = sequence_of(bag(tmp_path / name, False, ("/image", IMAGE, make)), camera=small_room.camera)
        values = read_image(found.files[0])
        assert values.shape == (4, 6, 3)
        assert np.ptp(values) == 0


def test_two_topics_are_joined_only_where_both_are(small_room: Dataset, tmp_path: Path) -> None:
    def one(topic: str, stamp: int, value: int):
        return (topic, IMAGE, lambda ros: ros.image(stamp, np.full((4, 5), value, np.uint8)))

    # Another order in the bag than in time, and one that is alone.
    path = bag(
        tmp_path / "bag", False,
        one("/front", 1 * S, 1), one("/front", 2 * S, 2), one("/back", 2 * S + 1000, 12), one("/back", 1 * S, 11),
        one("/front", 3 * S, 3), one("/front", 4 * S, 4), one("/back", 4 * S, 14),
    )  # fmt: skip
    settings = RecordingSettings(image_topic=("/front", "/back"))
    found = sequence_of(path, settings, small_room.camera)
    assert len(found) == 3
    pairs = [tuple(read_image(file)[0, [0, -1]].tolist()) for file in found.files]
    assert pairs == [(1, 11), (2, 12), (4, 14)]
    assert tuple(read_image(found.files[0])[0, [0, -1]].tolist()) == (1, 11)
    assert found.image_size == (10, 4)
    apart = bag(tmp_path / "apart", False, one("/front", 1 * S, 1), one("/back", 9 * S, 11))
    with pytest.raises(DatasetError, match="have the same stamp"):
        sequence_of(apart, settings, small_room.camera)
    odd = ("/back", IMAGE, lambda ros: ros.image(1 * S, np.zeros((9, 5), np.uint8)))
    with pytest.raises(DatasetError, match="images of 4x5 and 9x5 cannot be joined"):
        sequence_of(bag(tmp_path / "odd", False, one("/front", 1 * S, 1), odd), settings, small_room.camera)
