"""Cameras: which ray every pixel looks along, and what the sensor makes of the light."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.rays import directions_of
from panoloc_mcl.laboratory.simulation.settings import Sensor
from panoloc_mcl.robot.camera.spec import AnyCamera
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.images import read_image

FloatArray = NDArray[np.float64]

# A surface of this albedo is as bright as the mean of the image.
MEAN_ALBEDO = 0.3


@dataclass(frozen=True, eq=False)
class RayTable:
    """Rays of a camera in the axes of the robot that it is mounted on (x ahead, y left, z up).

    Parameters
    ----------
    directions : ndarray of float64, shape (pixels * samples, 3)
        All samples of one pixel one after the other.
    pixel : ndarray of int64, shape (pixels,)
        Which pixels these are, row by row; the camera sees nothing in the others.
    size : (int, int)
        Width and height of the image.
    samples : int
        Rays a pixel.
    """

    directions: FloatArray
    pixel: NDArray[np.int64]
    size: tuple[int, int]
    samples: int


def ray_table(camera: AnyCamera, size: tuple[int, int], samples: int) -> RayTable:
    """Rays through a regular grid of ``samples`` x ``samples`` points in every pixel."""
    width, height = size
    at = (np.arange(samples) + 0.5) / samples - 0.5
    v, u, dv, du = np.meshgrid(np.arange(height), np.arange(width), at, at, indexing="ij")
    column, row = (np.asarray(part, dtype=np.float64).reshape(-1) for part in (u + du, v + dv))
    azimuth, elevation, seen = directions_of(camera, size, column, row)
    whole = seen.reshape(-1, samples * samples).all(axis=1)
    keep = np.repeat(whole, samples * samples)
    a, e = azimuth[keep], elevation[keep]
    directions = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]) @ camera.mounting.rotation.T
    return RayTable(directions, np.flatnonzero(whole), size, samples * samples)


def tilted(directions: FloatArray, pitch: float, roll: float) -> FloatArray:
    """Directions (n, 3) of a camera that is tilted by small angles, radians: nose down and to the right."""
    if pitch == 0.0 and roll == 0.0:
        return directions
    cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return np.asarray(directions @ (about_y @ about_x).T)


def overlaid(luminance: FloatArray, seen: NDArray[np.bool_], body: NDArray[np.uint8], gamma: float) -> FloatArray:
    """What is fixed to the camera before the scene, lit as the scene is on average.

    Parameters
    ----------
    luminance : ndarray of float64, shape (height, width)
        Of the scene, cd/m2.
    seen : ndarray of bool, shape (height, width)
    body : ndarray of uint8, shape (height, width, 2)
        Grey levels, and opacity.
    gamma : float
        Of the grey levels.
    """
    albedo, cover = (body[..., 0] / 255.0) ** gamma, body[..., 1] / 255.0
    lit = albedo / MEAN_ALBEDO * float(luminance[seen].mean())
    return np.asarray(luminance + cover * (lit - luminance))


def read_body(path: Path, size: tuple[int, int]) -> NDArray[np.uint8]:
    """The picture of a robot's body: grey levels and opacity, uint8 (height, width, 2).

    Raises
    ------
    ConfigError
        Another size than the camera's images, or no transparency.
    ImageError
        It cannot be read.
    """
    image = read_image(path)
    if image.shape[1::-1] != size:
        found = " x ".join(str(part) for part in image.shape[1::-1])
        raise ConfigError(f"body = {path}: {found} pixels where images have {size[0]} x {size[1]}; use the camera's own size")
    if image.ndim != 3 or image.shape[2] != 4 or image.dtype != np.uint8:
        raise ConfigError(
            f"body = {path}: has no transparency; save it as an 8-bit PNG that is transparent where the world is seen"
        )
    grey = cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2GRAY)
    return np.stack([np.asarray(grey, dtype=np.uint8), image[..., 3]], axis=-1)


def expose(
    luminance: FloatArray, seen: NDArray[np.bool_], sensor: Sensor, rng: np.random.Generator, auto_exposure: bool = False
) -> NDArray[np.uint8]:
    """Grey levels of an image, with shot and read noise.

    Parameters
    ----------
    luminance : ndarray of float64, shape (height, width)
        cd/m2.
    seen : ndarray of bool, shape (height, width)
        Black elsewhere.
    sensor : Sensor
    rng : numpy.random.Generator
    auto_exposure : bool
        Let the median of the image decide, as cameras do that are not told otherwise.
    """
    full = sensor.full_scale_lux / math.pi
    if auto_exposure:
        full = max(float(np.median(luminance[seen])) / 0.13, 1e-3)
    electrons = luminance / full * sensor.full_well
    noise = rng.standard_normal((2, *luminance.shape))
    electrons = electrons + np.sqrt(np.clip(electrons, 0.0, None)) * noise[0] + sensor.read_noise * noise[1]
    share = np.clip(electrons / sensor.full_well, 0.0, 1.0) ** (1.0 / sensor.gamma)
    return np.where(seen, np.round(255.0 * share), 0.0).astype(np.uint8)
