"""Every format's example file is read, and projects as the tool that wrote it does: its published formula, with the file's numbers."""

import math
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import TypeAdapter

from panoloc_mcl.robot.camera.formats import read_calibration
from panoloc_mcl.robot.camera.lenses import Lens
from panoloc_mcl.robot.errors import CameraError

EXAMPLES = Path(__file__).parent / "examples"
RNG = np.random.default_rng(3)
ANGLES = RNG.uniform(0.02, 1.6, 40)
AROUND = RNG.uniform(0.0, 2.0 * np.pi, 40)
RAYS = np.stack([np.sin(ANGLES) * np.cos(AROUND), np.sin(ANGLES) * np.sin(AROUND), np.cos(ANGLES)], axis=-1)
FRONT = RAYS[ANGLES < 1.4]


def lens_of(name: str, camera: str | int | None = None):
    calibration = read_calibration(EXAMPLES / name, camera)
    assert calibration.lens is not None
    return TypeAdapter(Lens).validate_python(calibration.lens), calibration


def assert_projects(lens, rays, expected) -> None:
    u, v = lens.project(rays)
    assert np.hypot(u - expected[:, 0], v - expected[:, 1]).max() < 0.05


def equidistant(rays, fx, fy, cx, cy, k):
    theta = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    r = theta + k[0] * theta**3 + k[1] * theta**5 + k[2] * theta**7 + k[3] * theta**9
    around = np.arctan2(rays[:, 1], rays[:, 0])
    return np.stack([fx * r * np.cos(around) + cx, fy * r * np.sin(around) + cy], axis=-1)


def mei(rays, xi, fx, fy, cx, cy, k1, k2, p1, p2, skew=0.0):
    x, y = (rays[:, :2] / (rays[:, 2:] + xi)).T
    r2 = x**2 + y**2
    xd = x * (1 + k1 * r2 + k2 * r2**2) + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    yd = y * (1 + k1 * r2 + k2 * r2**2) + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.stack([fx * xd + skew * yd + cx, fy * yd + cy], axis=-1)


def test_ocamcalib() -> None:
    lens, calibration = lens_of("calib_results.txt")
    inverse = [194.21, 118.54, -5.31, 9.18, 5.97, -1.68, 1.73, 1.91, 0.34]
    expected = []
    for right, down, ahead in RAYS:
        # world2cam: x down the rows, y along the columns, z into the camera.
        theta = math.atan(-ahead / math.hypot(down, right))
        rho = sum(c * theta**i for i, c in enumerate(inverse))
        x, y = down / math.hypot(down, right) * rho, right / math.hypot(down, right) * rho
        row, column = x * 0.99987 + y * 0.000142 + 238.391502, x * -0.000211 + y + 317.612044
        expected.append((column, row))
    assert_projects(lens, RAYS, np.array(expected))
    assert (calibration.tool, calibration.size_px) == ("OCamCalib", (640, 480))


def test_kalibr() -> None:
    lens, calibration = lens_of("camchain_omni.yaml")
    assert_projects(lens, RAYS, mei(RAYS, 1.8476, 812.4, 811.9, 372.6, 238.1, -0.2134, 0.0917, 0.00043, -0.00021))
    assert calibration.size_px == (752, 480)
    lens, _ = lens_of("camchain_omni.yaml", "cam1")
    x, y, z = RAYS.T
    d1 = np.sqrt(x**2 + y**2 + z**2)
    d2 = np.sqrt(x**2 + y**2 + (-0.2786 * d1 + z) ** 2)
    below = 0.5567 * d2 + (1 - 0.5567) * (-0.2786 * d1 + z)
    assert_projects(lens, RAYS, np.stack([157.21 * x / below + 255.14, 157.19 * y / below + 256.9], axis=-1))
    lens, _ = lens_of("camchain_omni.yaml", 2)
    d = np.sqrt(1.0452 * (x**2 + y**2) + z**2)
    below = 0.6313 * d + (1 - 0.6313) * z
    assert_projects(lens, RAYS, np.stack([461.0 * x / below + 365.2, 460.4 * y / below + 249.3], axis=-1))
    lens, _ = lens_of("camchain_omni.yaml", "cam3")
    expected = equidistant(RAYS, 190.978, 190.973, 254.931, 256.897, [0.00347, 0.00071, -0.00205, 0.0002])
    assert_projects(lens, RAYS, expected)


def test_opencv_by_opencv_itself() -> None:
    lens, _ = lens_of("fisheye.yaml")
    matrix = np.array([[361.2, 0.0, 641.3], [0.0, 360.9, 482.7], [0.0, 0.0, 1.0]])
    zero = np.zeros(3)
    expected, _ = cv2.fisheye.projectPoints(FRONT[:, None, :], zero, zero, matrix, np.array([-0.0132, 0.0211, -0.0153, 0.0031]))
    assert_projects(lens, FRONT, expected[:, 0])
    lens, calibration = lens_of("omnidir.yaml")
    assert_projects(lens, RAYS, mei(RAYS, 1.5274, 1263.4, 1262.8, 640.2, 478.9, -0.3102, 0.1403, 0.00052, -0.00031, skew=0.41))
    assert (calibration.tool, calibration.size_px) == ("OpenCV", (1280, 960))


def test_camodocal() -> None:
    lens, calibration = lens_of("camodocal_mei.yaml")
    numbers = (1.9926618, 669.894046, 669.145061, 377.945925, 279.636557, -0.03992589, 0.15160828, 0.00017757, -0.00115312)
    assert_projects(lens, RAYS, mei(RAYS, *numbers))
    assert (calibration.tool, calibration.size_px) == ("CamOdoCal", (752, 480))
    lens, _ = lens_of("camodocal_kannala_brandt.yaml")
    k = [0.00348238940225, 0.00071503484867, -0.00205323614187, 0.00020293673591]
    assert_projects(lens, RAYS, equidistant(RAYS, 190.978477, 190.973307, 254.931706, 256.897443, k))


def test_ros() -> None:
    lens, calibration = lens_of("camera_info.yaml")
    assert_projects(lens, RAYS, equidistant(RAYS, 286.1, 286.3, 419.6, 403.2, [-0.00894, 0.04588, -0.04312, 0.00778]))
    assert (calibration.tool, calibration.size_px) == ("ROS camera_info", (848, 800))


def test_colmap_counts_from_the_corner() -> None:
    lens, _ = lens_of("cameras.txt")
    expected = equidistant(RAYS, 361.2, 360.9, 641.8, 483.2, [-0.0132, 0.0211, -0.0153, 0.0031])
    assert_projects(lens, RAYS, expected - 0.5)
    sphere = read_calibration(EXAMPLES / "cameras.txt", 2)
    assert sphere.mapping() == {"kind": "equirectangular"}


@pytest.mark.parametrize(
    ("name", "camera", "words"),
    [
        ("camchain_omni.yaml", "cam4", ["cam4", "pinhole", "radtan", "no panorama's", "pinhole-equi"]),
        ("camchain_omni.yaml", "cam9", ["camera_name = cam9", "cam0", "name one"]),
        ("cameras.txt", 3, ["camera 3", "PINHOLE", "OPENCV_FISHEYE"]),
        ("missing.txt", None, ["missing.txt", "no such file"]),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(name: str, camera, words: list[str]) -> None:
    with pytest.raises(CameraError) as caught:
        read_calibration(EXAMPLES / name, camera)
    (line,) = caught.value.faults
    assert all(word in line for word in words), line


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("hello: world\n", ["no calibration file of a known kind", "OCamCalib"]),
        ("model_type: PINHOLE\n", ["model_type = 'PINHOLE'", "MEI"]),
        ("distortion_model: plumb_bob\n", ["plumb_bob", "equidistant"]),
        ("%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 0., 1., 0., 1., 1., 0., 0., 1. ]\n",
         ["distortion coefficients", "D"]),
        ("cam0:\n  camera_model: ds\n  intrinsics: [0.1, 0.5]\n  resolution: [4, 4]\n  distortion_model: none\n",
         ["intrinsics", "6 finite numbers"]),
        ("#polynomial coefficients\n3 1 2 3\n", ["1 rows of numbers", "5"]),
    ],
)  # fmt: skip
def test_a_damaged_file_is_named(tmp_path: Path, text: str, words: list[str]) -> None:
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(CameraError) as caught:
        read_calibration(tmp_path / "c.yaml")
    (line,) = caught.value.faults
    assert all(word in line for word in ["c.yaml", *words]), line


@pytest.mark.parametrize(
    "head", ["%YAML:1784771\n--\n", "%YAML:17847715128717\n   mv: 190.9\n.0\n--\n", "%YAML:1.0\n--\n", "%", "%YAML:2.0\n---\n"]
)
def test_opencv_files_with_a_damaged_head_are_one_line_and_do_not_hang(head: str, tmp_path: Path) -> None:
    """Some of them kept OpenCV's own parser busy for ever, so a process of its own reads them."""
    text = (EXAMPLES / "camodocal_kannala_brandt.yaml").read_text().partition("---\n")[2]
    path = tmp_path / "damaged.yaml"
    path.write_text(head + text)
    code = (
        "import sys\nfrom pathlib import Path\nfrom panoloc_mcl.robot.camera.formats import read_calibration\n"
        "from panoloc_mcl.robot.errors import CameraError\n"
        "try:\n    read_calibration(Path(sys.argv[1]))\nexcept CameraError as error:\n    print('refused', len(error.faults))\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=10, check=False)
    assert done.stdout == "refused 1\n", done.stderr


@pytest.mark.parametrize(
    ("name", "change"),
    [
        # What OpenCV's own parser ran on over for ever, and what made it end the process.
        ("camodocal_mei.yaml", ("   gamma1: 669.8940458885896\n", "%YAML:1.0\n")),
        ("camodocal_mei.yaml", ("---\n", "\xad--\n")),
        ("fisheye.yaml", ("cols: 3", "cols: 1e-320")),
        ("fisheye.yaml", ("cols: 3", "cols: 99999999999")),
        ("fisheye.yaml", ("rows: 3", "rows: 2")),
        ("fisheye.yaml", ("dt: d", "dt: z")),
        ("fisheye.yaml", ("data: [ 361.2, 0.,", "data: [ 361.2, [0.],")),
    ],
)
def test_damaged_opencv_files_are_one_line(name: str, change: tuple[str, str], tmp_path: Path) -> None:
    text = (EXAMPLES / name).read_text()
    assert change[0] in text
    path = tmp_path / "damaged.yaml"
    path.write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises(CameraError) as caught:
        read_calibration(path)
    (line,) = caught.value.faults
    assert "damaged.yaml" in line
    assert "\n" not in line


def test_an_opencv_file_need_not_know_the_size_of_images(tmp_path: Path) -> None:
    path = tmp_path / "sizeless.yaml"
    path.write_text((EXAMPLES / "fisheye.yaml").read_text().replace("image_height: 960\n", ""))
    assert "size_px" not in read_calibration(path).mapping()


@pytest.mark.slow
def test_opencv_files_may_hold_numbers_as_opencv_writes_them_and_all_that_was_calibrated_with(tmp_path: Path) -> None:
    text = (EXAMPLES / "fisheye.yaml").read_text().replace("0.0211", "211e-4").replace("-0.0132", "-.0132")
    points = ", ".join(f"{0.5 * number}" for number in range(40_000))
    text += f'image_points: !!opencv-matrix\n   rows: 50\n   cols: 400\n   dt: "2f"\n   data: [ {points} ]\n'
    path = tmp_path / "whole.yml"
    path.write_text(text)
    assert read_calibration(path).mapping() == read_calibration(EXAMPLES / "fisheye.yaml").mapping()


@pytest.mark.parametrize(
    "head",
    [
        "%YAML:1.0\n---\n",
        "%YAML 1.2\n---\n",
        "%YAML:1.0\r\n---\r\n",
        "",
        # Settings of ORB-SLAM and VINS begin like this.
        "%YAML:1.0\n",
        "%YAML:1.0\n\n#------------\n# Camera Parameters\n\n",
        "%YAML:1.0\n# of the front camera\n---\n",
    ],
)
def test_heads_of_opencv_files_that_people_have(head: str, tmp_path: Path) -> None:
    original = EXAMPLES / "camodocal_kannala_brandt.yaml"
    path = tmp_path / "other.yaml"
    path.write_text(head + original.read_text().partition("---\n")[2], newline="")
    assert read_calibration(path).mapping() == read_calibration(original).mapping()
