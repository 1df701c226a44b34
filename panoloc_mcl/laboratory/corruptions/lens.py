"""What a lens and a cheap camera do to the light: focus, motion, vignetting, flare, exposure, noise, compression.

Every class is a disturbance with its severity: called with light (float32, linear, 1 where the camera is full) and a `View`, it gives
light of the same shape. Angles are in degrees, so a severity means the same at every resolution.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import convolve1d, gaussian_filter

from panoloc_mcl.laboratory.corruptions.draft import GAMMA, Float32, View
from panoloc_mcl.robot.settings.validation import StrictModel

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Angle = Annotated[float, Field(ge=0.0, le=45.0)]

# Grey levels from which on a pixel may have been brighter than it shows.
_FULL = 0.9
# Turns that make up a motion blur, a degree.
_TURNS_PER_DEGREE = 2.0


class Defocus(StrictModel):
    """Out of focus: a Gaussian over the image."""

    sigma_deg: Angle

    def __call__(self, light: Float32, view: View) -> Float32:
        """Blurred light."""
        return blurred(light, view, self.sigma_deg)


class MotionBlur(StrictModel):
    """The robot turns while the shutter is open: directions within ``degrees`` of azimuth run into each other."""

    degrees: Angle

    def __call__(self, light: Float32, view: View) -> Float32:
        """Mean over the turn."""
        if view.sight.goes_round:
            half = 0.5 * max(1.0, self.degrees * view.sight.pixels_per_degree)
            columns = np.arange(-math.ceil(half - 0.5), math.ceil(half - 0.5) + 1)
            # Those at the ends are covered in part.
            weights = np.clip(half + 0.5 - np.abs(columns), 0.0, 1.0)
            return np.asarray(convolve1d(light, weights / weights.sum(), axis=1, mode="wrap"), dtype=np.float32)
        turns = np.radians(np.linspace(-0.5, 0.5, max(2, round(self.degrees * _TURNS_PER_DEGREE))) * self.degrees)
        parts = [view.sight.sample(light, view.sight.azimuth + turn, view.sight.elevation) for turn in turns]
        return np.asarray(np.mean([part.reshape(light.shape) for part in parts], axis=0), dtype=np.float32)


class Vignetting(StrictModel):
    """Light falls off from the middle of the field to its rims, by ``share`` there."""

    share: Share

    def __call__(self, light: Float32, view: View) -> Float32:
        """Dimmed light."""
        low, high = view.sight.field
        away = (view.sight.elevation - 0.5 * (low + high)) / (0.5 * (high - low))
        return np.asarray(light * (1.0 - self.share * away**2)[..., None], dtype=np.float32)


class Flare(StrictModel):
    """Bloom around bright light and a veil over everything: what the lens scatters.

    What is at full scale is taken to have been ``brighter`` times as bright; ``share`` of such light spreads over ``sigma_deg``, and
    ``veil`` of the mean of all light lies over the whole image.
    """

    share: Share
    sigma_deg: Angle
    veil: Share
    brighter: Annotated[float, Field(ge=1.0, le=1000.0)] = 4.0

    def __call__(self, light: Float32, view: View) -> Float32:
        """Light with what is scattered."""
        bright = np.clip((light - _FULL) / (1.0 - _FULL), 0.0, 1.0) * light * self.brighter
        scattered = self.share * blurred(np.asarray(bright, dtype=np.float32), view, self.sigma_deg)
        return np.asarray(light + scattered + self.veil * mean_light(light, view), dtype=np.float32)


class Exposure(StrictModel):
    """Automatic exposure and white balance that hunt: ``stops`` from image to image, ``tint`` of one colour against another.

    The exposure brings the median to a fixed grey and errs by a normal deviate of ``stops``; what was cut off at full scale stays so.
    """

    stops: Annotated[float, Field(ge=0.0, le=5.0)]
    tint: Share = 0.0

    def __call__(self, light: Float32, view: View) -> Float32:
        """Light times what the camera decides."""
        errs, *colours = view.rng.normal(0.0, 1.0, 1 + light.shape[2])
        middle = max(float(np.median(light[view.sight.seen])), 1e-4)
        gains = np.full(light.shape[2], 0.13 / middle * 2.0 ** (self.stops * errs))
        if light.shape[2] > 1:
            gains *= np.exp(self.tint * np.asarray(colours))
        return np.asarray(light * gains, dtype=np.float32)


class Sensor(StrictModel):
    """A cheap sensor: shot noise, read noise, pixels that differ for good, and some that are dead or hot.

    Parameters are electrons at full scale, electrons rms, the relative sd of the pixels' gains, and the share of broken pixels.
    """

    full_well: Annotated[float, Field(ge=10.0, le=1e6)]
    read_noise: Annotated[float, Field(ge=0.0, le=1e4)]
    pattern: Share
    broken: Share

    def __call__(self, light: Float32, view: View) -> Float32:
        """What is counted, as light again."""
        shape = light.shape
        fixed = view.fixed()
        gains = 1.0 + self.pattern * fixed.standard_normal(shape)
        broken = fixed.random(shape) < self.broken
        level = fixed.integers(0, 2, shape)
        electrons = np.minimum(light, 1.0) * gains * self.full_well
        counted = view.rng.poisson(np.maximum(electrons, 0.0)) + view.rng.normal(0.0, self.read_noise, shape)
        return np.asarray(np.where(broken, level, counted / self.full_well), dtype=np.float32)


class Jpeg(StrictModel):
    """Compression."""

    quality: Annotated[int, Field(ge=1, le=100)]

    def __call__(self, light: Float32, view: View) -> Float32:
        """Light of the decoded image."""
        levels = levels_of(light)
        _, encoded = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, self.quality])
        decoded = cv2.imdecode(encoded, cv2.IMREAD_UNCHANGED)
        return light_of(np.asarray(decoded).reshape(light.shape))


def light_of(image: NDArray[np.uint8] | NDArray[np.uint16]) -> Float32:
    """Linear light of 8- or 16-bit grey levels, float32 (rows, columns, 1 or 3); an alpha channel is left out."""
    full = 65535.0 if image.dtype == np.uint16 else 255.0
    levels = image[:, :, None] if image.ndim == 2 else image[:, :, :3]
    return np.asarray((levels / np.float32(full)) ** np.float32(GAMMA), dtype=np.float32)


def levels_of(light: Float32) -> NDArray[np.uint8]:
    """8-bit grey levels of light; a single channel is left out of the shape."""
    levels = np.rint(255.0 * np.clip(light, 0.0, 1.0) ** (1.0 / GAMMA))
    return np.asarray(levels[:, :, 0] if light.shape[2] == 1 else levels, dtype=np.uint8)


def blurred(light: Float32, view: View, sigma_deg: float) -> Float32:
    """A Gaussian over rows and columns, round the circle in a panorama; never over the channels."""
    sigma = sigma_deg * view.sight.pixels_per_degree
    if sigma == 0.0:
        return light
    across: Literal["wrap", "nearest"] = "wrap" if view.sight.goes_round else "nearest"
    return np.asarray(gaussian_filter(light, sigma, mode=("nearest", across), axes=(0, 1)), dtype=np.float32)


def mean_light(light: Float32, view: View) -> Float32:
    """Of what is seen, by channel."""
    return np.asarray(light[view.sight.seen].mean(axis=0), dtype=np.float32)
