"""Cameras: which ray every pixel looks along, and what the sensor makes of the light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.rays import directions_of
from panoloc_mcl.laboratory.simulation.settings import Sensor
from panoloc_mcl.robot.camera.spec import AnyCamera

FloatArray = NDArray[np.float64]


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
