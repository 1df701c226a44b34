from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import (
    Mask,
    OmniCamera,
    PanoramaCamera,
    PanoramaGeometry,
    Unwrapper,
    camera_from_mapping,
    geometry_of,
    radius_px,
)
from panoloc_mcl.robot.errors import CameraError, ImageError

SHARED = Path(__file__).parents[4] / "shared" / "data"
WIDTH, HEIGHT = 48, 20
CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0))
GEOMETRY = geometry_of(CAMERA, (WIDTH, HEIGHT))


def noise(seed: int, shape: tuple[int, ...] = (HEIGHT, WIDTH), dtype: type = np.uint8) -> NDArray[Any]:
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)


def smooth(geometry: PanoramaGeometry) -> NDArray[np.uint8]:
    """A picture without detail finer than a few pixels."""
    azimuth = geometry.azimuth_of_column(np.arange(geometry.width))[None, :]
    return picture(azimuth, geometry.elevation_of_row(np.arange(geometry.height))[:, None])


def picture(azimuth: NDArray[Any], elevation: NDArray[Any]) -> NDArray[np.uint8]:
    wave = 50.0 * np.sin(azimuth) + 30.0 * np.cos(5.0 * azimuth + 1.0) + 40.0 * np.sin(4.0 * elevation)
    return np.asarray(np.rint(128.0 + wave), dtype=np.uint8)


def turned(image: NDArray[Any], turn: float, camera: PanoramaCamera = CAMERA) -> NDArray[np.float32]:
    size = (image.shape[1], image.shape[0])
    return Unwrapper(camera, size, geometry_of(camera, size), turn)(image).pixels


@given(st.integers(-200, 200), st.integers(0, 1000))
def test_turning_left_by_whole_columns_rolls_to_the_right(columns: int, seed: int) -> None:
    image = noise(seed)
    assert np.array_equal(turned(image, columns * 2.0 * np.pi / WIDTH), np.roll(image, columns, axis=1))


@given(st.integers(0, WIDTH), st.integers(0, 1000))
def test_turning_left_and_right_again_gives_the_image_back(columns: int, seed: int) -> None:
    image, turn = noise(seed), columns * 2.0 * np.pi / WIDTH
    assert np.array_equal(turned(turned(image, turn).astype(np.uint8), -turn), image)


@settings(max_examples=25)
@given(st.floats(-7.0, 7.0))
def test_any_turn_shows_what_the_turned_robot_sees(turn: float) -> None:
    geometry = PanoramaGeometry(180, 60, -50.0, 25.0)
    azimuth = geometry.azimuth_of_column(np.arange(180))[None, :] + turn
    expected = picture(azimuth, geometry.elevation_of_row(np.arange(60))[:, None])
    assert np.abs(turned(smooth(geometry), turn) - expected).max() < 2.5


@settings(max_examples=25)
@given(st.floats(-7.0, 7.0), st.integers(1, 75), st.floats(0.0, 6.0))
def test_fine_texture_is_turned_as_far_as_coarse(turn: float, waves: int, phase: float) -> None:
    """Up to 2.4 columns a wave: a heading is read off all of them."""
    geometry = PanoramaGeometry(180, 20, -50.0, 25.0)
    azimuth = geometry.azimuth_of_column(np.arange(180))[None, :]
    image = np.rint(128.0 + 100.0 * np.cos(waves * azimuth + phase)).astype(np.uint8).repeat(20, axis=0)
    expected = 128.0 + 100.0 * np.cos(waves * (azimuth + turn) + phase)
    assert np.abs(turned(image, turn) - expected).max() < 1.5


@pytest.mark.parametrize("columns", [3.2, -0.6])
@pytest.mark.parametrize("order", ["clockwise", "counterclockwise"])
def test_between_columns_of_the_robot_nothing_is_world(columns: float, order: Literal["clockwise", "counterclockwise"]) -> None:
    world = np.ones((HEIGHT, WIDTH), dtype=bool)
    world[:, 20:24] = False
    camera = PanoramaCamera(elevation_deg=(-50.0, 25.0), columns=order, mask=Mask(world))
    valid = Unwrapper(camera, (WIDTH, HEIGHT), GEOMETRY, columns * 2.0 * np.pi / WIDTH).valid
    assert valid is not None
    levels = Unwrapper(camera.model_copy(update={"mask": None}), (WIDTH, HEIGHT), GEOMETRY, columns * 2.0 * np.pi / WIDTH)(
        np.where(world, 255, 0).astype(np.uint8)
    ).pixels
    # The four columns lie on parts of five.
    assert (~valid[0]).sum() == 5
    assert levels[0][valid[0]].min() > 200.0
    assert levels[0][~valid[0]].max() < 250.0


def test_a_reference_is_brought_to_heading_zero() -> None:
    # A mark straight ahead of a robot that looks left (theta = 90 degrees) lies to the left once it looks ahead.
    image = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    image[:, 0] = 255
    column = int(np.argmax(turned(image, -np.pi / 2.0)[0]))
    assert GEOMETRY.azimuth_of_column(column) == pytest.approx(np.pi / 2.0)


@given(st.integers(-5, 60), st.booleans(), st.integers(0, 100))
def test_other_layouts_become_canonical_without_interpolation(heading: int, clockwise: bool, seed: int) -> None:
    canonical = noise(seed)
    order = "clockwise" if clockwise else "counterclockwise"
    column = np.arange(WIDTH)
    stored = canonical[:, (column - heading) % WIDTH] if clockwise else canonical[:, (heading - column) % WIDTH]
    camera = PanoramaCamera(columns=order, heading_column=float(heading), elevation_deg=(-50.0, 25.0))
    assert np.array_equal(turned(stored, 0.0, camera), canonical)


def test_the_canonical_image_is_passed_through() -> None:
    image = noise(3)
    panorama = Unwrapper(CAMERA, (WIDTH, HEIGHT), GEOMETRY)(image)
    assert panorama.valid is None
    assert panorama.pixels.dtype == np.float32
    assert np.array_equal(panorama.pixels, image)


def test_colour_and_depth() -> None:
    unwrap = Unwrapper(CAMERA, (WIDTH, HEIGHT), GEOMETRY)
    grey = noise(4)
    assert np.allclose(unwrap(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)).pixels, grey)
    assert np.allclose(unwrap(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA)).pixels, grey)
    assert np.array_equal(unwrap(grey[:, :, None]).pixels, grey)
    assert np.allclose(unwrap(grey.astype(np.uint16) * 257).pixels, grey, atol=1e-4)
    blue = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    blue[..., 0] = 255
    assert unwrap(blue).pixels.max() == pytest.approx(29.0)


@pytest.mark.parametrize(
    ("image", "word"),
    [
        (np.zeros((HEIGHT, WIDTH), dtype=np.float32), "float32"),
        (np.zeros((HEIGHT, WIDTH + 1), dtype=np.uint8), "49 x 20"),
        (np.zeros((HEIGHT, WIDTH, 2), dtype=np.uint8), "(20, 48, 2)"),
        (np.zeros(5, dtype=np.uint8), "5 pixels"),
        ("image.png", "str"),
    ],
)
def test_unusable_images_are_refused(image: Any, word: str) -> None:
    with pytest.raises(ImageError) as caught:
        Unwrapper(CAMERA, (WIDTH, HEIGHT), GEOMETRY)(image)
    assert word in str(caught.value)


def test_rows_that_the_camera_does_not_see_are_marked() -> None:
    wider = PanoramaGeometry(WIDTH, 20, -70.0, 5.0)
    panorama = Unwrapper(CAMERA, (WIDTH, HEIGHT), wider)(np.full((HEIGHT, WIDTH), 200, dtype=np.uint8))
    assert panorama.valid is not None
    seen = np.degrees(wider.elevation_of_row(np.arange(20))) > -50.0
    assert np.array_equal(panorama.valid.all(axis=1), seen)
    assert np.array_equal(panorama.pixels > 0.0, panorama.valid)


def test_a_camera_that_sees_nothing_of_the_panorama_is_refused() -> None:
    with pytest.raises(CameraError, match="elevation"):
        Unwrapper(CAMERA, (WIDTH, HEIGHT), PanoramaGeometry(WIDTH, 10, 40.0, 60.0))


def test_shrinking_averages_instead_of_skipping() -> None:
    fine = np.zeros((80, 720), dtype=np.uint8)
    fine[:, ::2] = 200
    panorama = Unwrapper(CAMERA, (720, 80), PanoramaGeometry(180, 40, -50.0, 25.0))(fine)
    assert panorama.pixels.mean() == pytest.approx(100.0, abs=2.0)
    assert panorama.pixels.std() < 5.0


PROFILES = [
    {"kind": "unified", "xi": 0.9, "focal_px": 122.2019},
    {"kind": "hyperbolic", "eccentricity": 1.5, "focal_px": 330.0},
    {"kind": "equiangular", "focal_px": 115.0},
    {"kind": "linear", "points": [[-50, 45], [25, 232]]},
    {"kind": "table", "points": [[-60, 30], [-50, 47], [-20, 100], [0, 150], [26, 234]]},
    {"kind": "linear", "points": [[-50, 232], [25, 45]]},
]


def omni_camera(**changes: Any) -> OmniCamera:
    data = {
        "kind": "omni", "center_px": [239.5, 239.5], "valid_radius_px": [28, 237], "profile": PROFILES[0],
        "panorama": {"size": [180, 72], "elevation_deg": [-50, 25]},
    }  # fmt: skip
    camera = camera_from_mapping({**data, **changes}, "x")
    assert isinstance(camera, OmniCamera)
    return camera


def omni_image(camera: OmniCamera) -> NDArray[np.uint8]:
    """What the camera takes of ``picture``, by looking from every image pixel into the world."""
    v, u = np.indices((480, 480), dtype=float)
    right, up = u - camera.center_px[0], camera.center_px[1] - v
    elevations = np.radians(np.linspace(-70.0, 40.0, 4000))
    radii = radius_px(camera.profile, elevations)
    known = np.isfinite(radii)
    order = np.argsort(radii[known])
    elevation = np.interp(np.hypot(right, up), radii[known][order], elevations[known][order])
    sense = 1.0 if camera.azimuth == "counterclockwise" else -1.0
    azimuth = sense * (np.arctan2(up, right) - np.radians(camera.heading_angle_deg))
    return picture(azimuth, elevation)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile["kind"])
@pytest.mark.parametrize(("heading", "sense"), [(90.0, "counterclockwise"), (-37.5, "clockwise")])
def test_an_omni_image_becomes_its_panorama(profile: dict[str, Any], heading: float, sense: str) -> None:
    camera = omni_camera(profile=profile, heading_angle_deg=heading, azimuth=sense)
    geometry = geometry_of(camera, (480, 480))
    panorama = Unwrapper(camera, (480, 480), geometry)(omni_image(camera))
    assert panorama.valid is None
    assert np.abs(panorama.pixels - smooth(geometry)).max() < 4.0


def test_a_turned_omni_image_is_the_rolled_panorama() -> None:
    camera = omni_camera()
    geometry = geometry_of(camera, (480, 480))
    image = omni_image(camera)
    straight = Unwrapper(camera, (480, 480), geometry)(image).pixels
    left = Unwrapper(camera, (480, 480), geometry, turn=np.radians(30.0))(image).pixels
    assert np.abs(left - np.roll(straight, 15, axis=1)).max() < 3.0


def test_what_lies_outside_the_ring_or_the_image_is_marked() -> None:
    camera = omni_camera(valid_radius_px=[80, 237], center_px=[200.0, 239.5])
    geometry = geometry_of(camera, (480, 480))
    panorama = Unwrapper(camera, (480, 480), geometry)(np.full((480, 480), 90, dtype=np.uint8))
    assert panorama.valid is not None
    radius = radius_px(camera.profile, geometry.elevation_of_row(np.arange(72)))
    assert not panorama.valid[radius < 79.0].any()
    ahead, left = 0, 135
    assert panorama.valid[radius > 90.0, ahead].all()
    assert not panorama.valid[radius > 202.0, left].any()
    assert np.array_equal(panorama.pixels > 0.0, panorama.valid)


@pytest.mark.skipif(not (SHARED / "hall_omni").is_dir(), reason="shared data not at hand")
@pytest.mark.parametrize("sequence", ["noon_00", "afternoon_01", "evening_00"])
def test_recorded_omni_images_agree_with_the_panoramas_of_the_same_instants(sequence: str) -> None:
    from panoloc_mcl.tools.datasets import read_dataset, read_image

    omni = read_dataset(SHARED / "hall_omni").sequences[sequence]
    unwrap = Unwrapper(omni.camera, omni.image_size, geometry_of(omni.camera, omni.image_size))
    hall = read_dataset(SHARED / "hall").sequences[sequence]
    same = Unwrapper(hall.camera, hall.image_size, unwrap.geometry)
    for time, file in zip(omni.times, omni.files, strict=True):
        got = unwrap(read_image(file)).pixels
        expected = same(read_image(hall.files[int(np.argmin(np.abs(hall.times - time)))])).pixels
        score = {k: np.corrcoef(np.roll(got, k, axis=1).ravel(), expected.ravel())[0, 1] for k in range(-10, 11)}
        assert max(score, key=lambda k: score[k]) == 0
        assert score[0] > 0.96
