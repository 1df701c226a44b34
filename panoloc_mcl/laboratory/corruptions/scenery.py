"""What stands in a real place and not in the model of a floor out to a wall: leaves, people, floors that mirror, the robot itself.

Every class is a disturbance with its severity, as those of `lens`.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import gaussian_filter

from panoloc_mcl.laboratory.corruptions.draft import Draft, Float32, Float64, View
from panoloc_mcl.laboratory.corruptions.lens import Angle, Share, mean_light
from panoloc_mcl.laboratory.corruptions.sight import Sight, sight_of
from panoloc_mcl.robot.camera.mask import Mask
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.settings.validation import StrictModel

# A surface of this reflectance is as bright as the mean of the image.
_MEAN_REFLECTANCE = 0.3

_CELL_M = 1.0
_NEAREST_M, _FARTHEST_M, _TALLEST_M = 0.4, 4.0, 2.2

_PERSON_M = 1.75
# Half the width of a person over height: legs, hips, chest, neck, head.
_OUTLINE: tuple[tuple[float, float], ...] = (
    (0.0, 0.13),
    (0.85, 0.17),
    (1.0, 0.2),
    (1.4, 0.24),
    (1.5, 0.08),
    (1.6, 0.1),
    (1.75, 0.06),
)
_CLOTHES = (0.85, 1.45)

_REFLECTANCE_OF_VARNISH = 0.04
_FLOOR_BELOW_DEG, _FLOOR_SURELY_BELOW_DEG = -6.0, -15.0

_BODY_TEXTURE_DEG = 1.2


class Foliage(StrictModel):
    """Leaves and twigs that hang in the air around the camera, each at its own place in the world: ``per_m3`` of them.

    They shift against each other from place to place, which no floor and wall explains, as grass, plants and cables do. Walls do not
    hide them; what is farther than 4 m is left out.
    """

    per_m3: Annotated[float, Field(ge=0.0, le=200.0)]
    size_m: Annotated[float, Field(gt=0.0, le=0.5)] = 0.03

    def __call__(self, light: Float32, view: View) -> Float32:
        """Light with the leaves before it."""
        if view.pose is None:
            raise ConfigError("foliage: stays in its place, so it needs the true poses; use sequences with ground truth")
        leaves = self._leaves(view)
        x, y, z, size, reflectance, squeeze, lean = leaves[:, np.argsort(-np.hypot(leaves[0], leaves[1]))]
        away = np.hypot(x, y)
        azimuth, elevation = np.arctan2(y, x) - view.pose[2], np.arctan2(z - view.height_m, away)
        low, high = view.sight.field
        column, row = view.sight.pixels_of(azimuth, elevation)
        radius = np.degrees(size / np.hypot(away, z - view.height_m)) * view.sight.pixels_per_degree
        lit = reflectance[:, None] / _MEAN_REFLECTANCE * mean_light(light, view)
        out = light.copy()
        for k in np.flatnonzero((elevation > low) & (elevation < high)):
            _paint(out, float(column[k]), float(row[k]), float(radius[k]), float(squeeze[k]), float(lean[k]), lit[k])
        return out

    def _leaves(self, view: View) -> Float64:
        """Relative position, size, reflectance, shape and direction of all that are near; float64 (7, n)."""
        assert view.pose is not None
        reach = math.ceil(_FARTHEST_M / _CELL_M)
        cell = np.floor(view.pose[:2] / _CELL_M).astype(int)
        parts = []
        for i in range(cell[0] - reach, cell[0] + reach + 1):
            for j in range(cell[1] - reach, cell[1] + reach + 1):
                # Seeds are not negative.
                rng = view.fixed(i + 2**31, j + 2**31)
                count = rng.poisson(self.per_m3 * _CELL_M**2 * _TALLEST_M)
                u = rng.random((6, count))
                x, y = (i + u[0]) * _CELL_M - view.pose[0], (j + u[1]) * _CELL_M - view.pose[1]
                sizes = self.size_m * np.exp(0.5 * rng.standard_normal(count))
                parts.append(np.stack([x, y, u[2] * _TALLEST_M, sizes, 0.02 + 0.5 * u[3] ** 2, 0.3 + 0.7 * u[4], np.pi * u[5]]))
        leaves = np.concatenate(parts, axis=1)
        away = np.hypot(leaves[0], leaves[1])
        return np.asarray(leaves[:, (away > _NEAREST_M) & (away < _FARTHEST_M)])


def _paint(
    out: Float32, column: float, row: float, radius: float, squeeze: float, lean: float, lit: NDArray[np.float32]
) -> None:
    """An ellipse with soft edges over the image; columns are a circle."""
    reach = math.ceil(radius + 1.0)
    rows = np.arange(max(0, round(row) - reach), min(out.shape[0], round(row) + reach + 1))
    columns = np.arange(round(column) - reach, round(column) + reach + 1)
    du, dv = columns[None, :] - column, rows[:, None] - row
    along, across = math.cos(lean) * du + math.sin(lean) * dv, (math.cos(lean) * dv - math.sin(lean) * du) / squeeze
    cover = np.clip(radius - np.hypot(along, across) + 0.5, 0.0, 1.0)
    # One that is smaller than a pixel covers a part of it.
    cover *= min(1.0, 4.0 * radius * radius)
    where = np.ix_(rows, columns % out.shape[1])
    out[where] += (cover[..., None] * (lit - out[where])).astype(np.float32)


class Reflections(StrictModel):
    """A varnished floor: what lies as high above the horizon as the floor below it is mirrored in it.

    By Fresnel's law (Schlick, 1994) times ``gloss``: faint below the robot, strong far off. Where the mirrored direction lies above
    the image, its upper rim is mirrored.
    """

    gloss: Share

    def __call__(self, light: Float32, view: View) -> Float32:
        """Light with what the floor mirrors."""
        elevation = view.sight.elevation
        mirrored = view.sight.sample(light, view.sight.azimuth, -elevation).reshape(light.shape)
        down = np.clip(-np.sin(elevation), 0.0, 1.0)
        share = _REFLECTANCE_OF_VARNISH + (1.0 - _REFLECTANCE_OF_VARNISH) * (1.0 - down) ** 5
        begins, surely = np.radians((_FLOOR_BELOW_DEG, _FLOOR_SURELY_BELOW_DEG))
        floor = np.clip((begins - elevation) / (begins - surely), 0.0, 1.0)
        weight = (self.gloss * share * floor * view.sight.seen)[..., None]
        return np.asarray(light + weight * mirrored, dtype=np.float32)


class People(StrictModel):
    """People who walk about the robot, 1 to 3 m away, and hide ``share`` of the columns together."""

    share: Share

    def __call__(self, light: Float32, view: View) -> Float32:
        """Light with people before it."""
        out, hidden, person = light.copy(), 0.0, 0
        heights, widths = np.array(_OUTLINE, dtype=np.float64).T
        while hidden < self.share * 2.0 * np.pi:
            rng = view.fixed(person)
            person += 1
            away = rng.uniform(1.0, 3.0) + 0.3 * math.sin(view.time * rng.uniform(0.2, 0.6))
            at = rng.uniform(-np.pi, np.pi) + view.time * rng.normal(0.0, 0.3) - (0.0 if view.pose is None else view.pose[2])
            clothes = rng.uniform(0.02, 0.7, 3)
            stripes, slant = rng.uniform(20.0, 60.0), rng.uniform(-1.0, 1.0)
            width = 2.0 * 0.24 / away
            # The last one is thinner, so that the share comes out as asked.
            thin = min(1.0, (self.share * 2.0 * np.pi - hidden) / width)
            hidden += width
            aside = away * _turn(view.sight.azimuth, at)
            height = view.height_m + away * np.tan(view.sight.elevation)
            outline = np.interp(height, heights, widths, left=-1.0, right=-1.0) * thin
            part = np.digitize(height, _CLOTHES)
            pattern = 1.0 + 0.3 * np.sign(np.sin(stripes * (height + slant * aside)))
            shade = np.sqrt(np.clip(1.0 - (aside / np.maximum(outline, 1e-6)) ** 2, 0.1, 1.0))
            lit = (clothes[part] / _MEAN_REFLECTANCE * pattern * shade)[..., None] * mean_light(light, view)
            inside = (np.abs(aside) < outline) & (height >= 0.0) & (height <= _PERSON_M)
            out[inside] = lit[inside]
        return out


class Body(StrictModel):
    """The robot that the camera stands on, fixed to it: a strut over all rows, a laptop over the lowest rows, a ring at the rim.

    ``laptop_share`` is the share of the field's height that the laptop reaches up; all of it has a texture of its own.
    """

    strut_deg: Annotated[float, Field(ge=0.0, le=180.0)]
    laptop_deg: Annotated[float, Field(ge=0.0, le=360.0)] = 90.0
    laptop_share: Share = 0.25
    ring_deg: Angle = 3.0
    strut_at_deg: float = 150.0
    laptop_at_deg: float = -100.0

    def hides(self, sight: Sight) -> NDArray[np.bool_]:
        """Which pixels it covers, bool (height, width)."""
        low, high = sight.field
        strut = np.abs(_turn(sight.azimuth, math.radians(self.strut_at_deg))) < 0.5 * math.radians(self.strut_deg)
        aside = _turn(sight.azimuth, math.radians(self.laptop_at_deg)) / max(0.5 * math.radians(self.laptop_deg), 1e-9)
        # Rounded, as things are.
        edge = low + self.laptop_share * (high - low) * np.sqrt(np.clip(1.0 - aside**4, 0.0, None))
        laptop = (np.abs(aside) < 1.0) & (sight.elevation < edge)
        ring = sight.elevation < low + math.radians(self.ring_deg)
        return np.asarray((strut | laptop | ring) & sight.seen)

    def tell(self, draft: Draft) -> None:
        """Give every camera that it hides a part of a mask."""
        for folder in draft.folders:
            if any(disturb is self for _, disturb in folder.disturbances):
                world = ~self.hides(sight_of(folder.optics, folder.size))
                known = folder.camera.mask
                mask = Mask(world if known is None else world & known.world)
                folder.camera = folder.camera.model_copy(update={"mask": mask})

    def __call__(self, light: Float32, view: View) -> Float32:
        """Light with the robot before it, lit as the place is."""
        shape = light.shape[:2]
        texture = gaussian_filter(view.fixed().standard_normal(shape), _BODY_TEXTURE_DEG * view.sight.pixels_per_degree)
        reflectance = 0.25 * np.exp(texture / texture.std())
        lit = np.minimum(reflectance, 0.9)[..., None] / _MEAN_REFLECTANCE * mean_light(light, view)
        return np.asarray(np.where(self.hides(view.sight)[..., None], lit, light), dtype=np.float32)


def _turn(azimuth: Float64, to: float) -> Float64:
    """From a direction to azimuths, radians in [-pi, pi)."""
    return np.asarray(np.mod(azimuth - to + np.pi, 2.0 * np.pi) - np.pi)
