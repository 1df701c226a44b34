"""A robot in its own images, found while it drives about; a world without one is left alone."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panoloc_mcl.robot.camera import EquirectangularCamera, LinearProfile, OmniCamera, PanoramaCamera, PanoramaTarget
from panoloc_mcl.robot.camera.body import find_body, lower_rim, ring_of

ROWS, COLUMNS, IMAGES = 60, 180, 40


def worlds(seed: int = 0) -> list[np.ndarray]:
    """Images that have nothing in common but their statistics, each in a light of its own, with noise."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(IMAGES):
        texture = gaussian_filter(rng.standard_normal((ROWS, COLUMNS)), 1.5, mode=("nearest", "wrap"))
        image = rng.uniform(60.0, 140.0) * np.exp(0.5 * texture / texture.std())
        found.append(np.clip(image + rng.normal(0.0, 1.5, image.shape), 1.0, 255.0).astype(np.float32))
    return found


def with_body(images: list[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray]:
    """A textured strut over all rows and a box in the lowest third, lit as each image is."""
    rng = np.random.default_rng(9)
    texture = np.exp(0.5 * gaussian_filter(rng.standard_normal((ROWS, COLUMNS)), 1.2) / 0.2)
    body = np.zeros((ROWS, COLUMNS), dtype=bool)
    body[:, 20:30] = True
    body[40:, 100:145] = True
    found = []
    for image in images:
        lit = np.clip(float(np.median(image)) * texture + rng.normal(0.0, 1.5, texture.shape), 1.0, 255.0)
        found.append(np.where(body, lit, image).astype(np.float32))
    return found, body


def test_the_body_is_found_and_the_world_kept() -> None:
    images, body = with_body(worlds())
    found = find_body(images)
    assert (~found.world)[body].mean() > 0.95
    # The rim that smoothing blurs, and no more.
    assert (~found.world)[~body].mean() < 0.08
    assert found.sure
    assert "sure" in found.verdict


def test_without_a_body_nothing_is_masked() -> None:
    found = find_body(worlds(3))
    assert found.hidden < 0.01
    assert found.varying > 0.8


def test_a_robot_that_stands_still_is_not_sure() -> None:
    rng = np.random.default_rng(1)
    still = [worlds()[0] + rng.normal(0.0, 1.0, (ROWS, COLUMNS)).astype(np.float32) for _ in range(20)]
    found = find_body(still)
    assert not found.sure
    assert "not observable" in found.verdict


def test_a_few_images_are_refused() -> None:
    with pytest.raises(ValueError, match="8 are needed"):
        find_body(worlds()[:5])


def test_a_plain_body_is_told_by_its_edges_and_a_plain_floor_is_kept() -> None:
    images = worlds(5)
    floor, strut = np.zeros((ROWS, COLUMNS), dtype=bool), np.zeros((ROWS, COLUMNS), dtype=bool)
    floor[48:] = True
    strut[:48, 60:90] = True
    rng = np.random.default_rng(2)
    plain = []
    for image in images:
        level, noise = float(np.median(image)), rng.normal(0.0, 1.0, image.shape)
        # The floor fades into the world, and is as bright as the place; the strut is half as bright, and ends sharply.
        fade = np.clip((np.arange(ROWS) - 40.0) / 8.0, 0.0, 1.0)[:, None]
        shown = (1.0 - fade) * image + fade * rng.uniform(0.8, 1.2) * level
        plain.append(np.where(strut, 0.5 * level, shown + noise).astype(np.float32))
    found = find_body(plain)
    assert (~found.world)[strut].mean() > 0.8
    assert (~found.world)[floor].mean() < 0.1


def test_what_is_left_out_without_doubt_has_a_texture_and_stands_below_the_camera() -> None:
    images, body = with_body(worlds(11))
    rim, far = np.zeros((ROWS, COLUMNS), dtype=bool), np.zeros((ROWS, COLUMNS), dtype=bool)
    rim[-3:] = True
    far[5:20, 130:160] = True
    for image in images:
        image[far] = images[0][far]
    found = find_body(images)
    assert (~found.world)[far].mean() > 0.95
    world = found.without_doubt(rim)
    assert (~world)[body].mean() > 0.95
    assert world[far].mean() > 0.95
    # With another end of what the camera sees, it is the other way round.
    rim[:] = False
    rim[5] = True
    assert found.without_doubt(rim)[40:, 100:145].mean() > 0.95


def test_a_plain_floor_between_walls_that_stay_is_no_body_without_doubt() -> None:
    """A robot along the middle of a corridor: the edges at its sides stay, the floor between them is plain."""
    rng = np.random.default_rng(6)
    images = []
    for image in worlds(7):
        image[30:] = 90.0 + rng.normal(0.0, 1.0, image[30:].shape)
        for side in (20, 110):
            image[36:40, side : side + 50] = 200.0 + rng.normal(0.0, 1.0, (4, 50))
        images.append(image.astype(np.float32))
    rim = np.zeros((ROWS, COLUMNS), dtype=bool)
    rim[-3:] = True
    found = find_body(images)
    # Whoever looks at the picture sees what it is.
    assert (~found.world)[36:40].mean() > 0.2
    assert found.without_doubt(rim).all()


def test_nobody_is_sure_means_that_nothing_is_left_out() -> None:
    still = [worlds()[0] + np.random.default_rng(i).normal(0.0, 1.0, (ROWS, COLUMNS)).astype(np.float32) for i in range(20)]
    assert find_body(still).without_doubt(np.ones((ROWS, COLUMNS), dtype=bool)).all()


def test_the_lower_rim_is_where_the_sight_ends_below() -> None:
    cylinder = lower_rim(PanoramaCamera(elevation_deg=(-50.0, 25.0)), (180, 60), None)
    assert cylinder[-3:].all()
    assert not cylinder[:-5].any()
    sphere = lower_rim(EquirectangularCamera(elevation_deg=(-60.0, 30.0)), (360, 180), None)
    # 60 degrees below the horizon of a full sphere, a row a degree.
    assert sphere[147:149].all()
    assert not sphere[152:].any()
    assert not sphere[:142].any()
    high = lower_rim(PanoramaCamera(elevation_deg=(-10.0, 60.0)), (180, 60), None)
    assert not high.any()


def test_the_lower_rim_of_a_mirror_is_the_inner_one() -> None:
    camera = OmniCamera(
        center_px=(100.0, 100.0),
        valid_radius_px=(30.0, 95.0),
        profile=LinearProfile(points=((-50.0, 35.0), (0.0, 75.0))),
        panorama=PanoramaTarget(size=(180, 60), elevation_deg=(-50.0, 20.0)),
    )
    size = (201, 201)
    rim = lower_rim(camera, size, ring_of(camera, size))
    v, u = np.nonzero(rim)
    radii = np.hypot(u - 100.0, v - 100.0)
    assert radii.min() > 25.0
    assert radii.max() < 48.0
    # All around.
    assert len(np.unique(np.degrees(np.arctan2(v - 100.0, u - 100.0)).round(-1))) >= 36
