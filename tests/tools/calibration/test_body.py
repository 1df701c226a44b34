"""A robot in its own images, found while it drives about; a world without one is left alone."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panoloc_mcl.tools.calibration.body import find_body

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
