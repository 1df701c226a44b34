"""Lenses that other tools calibrate: where a ray of the lens's own frame appears in the image.

The frame is that of computer vision: x to the right, y down, z along the optical axis out of the camera. Formulas are those of the
tools that estimated the parameters, so that their files can be used as they are:

* ``kannala_brandt``: Kannala & Brandt (2006); OpenCV's ``fisheye``, Kalibr's ``pinhole-equi``, ROS's ``equidistant``, COLMAP's
  ``OPENCV_FISHEYE``;
* ``mei``: Mei & Rives (2007), the unified sphere with radial and tangential distortion; OpenCV's ``omnidir``, CamOdoCal's ``MEI``,
  Kalibr's ``omni``;
* ``eucm``: Khomutenko, Garcia & Martinet (2016); ``double_sphere``: Usenko, Demmel & Cremers (2018); both as in Kalibr;
* ``ocam``: Scaramuzza, Martinelli & Siegwart (2006), OCamCalib's polynomials and affine part.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, Literal, Union

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag

from panoloc_mcl.robot.settings.validation import StrictModel, kind_tag

Float64 = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0.0)]

_STEP_DEG = 0.25
_DIRECTIONS = 16
_NEAR_AXIS_DEG = 5.0


class _Lens(StrictModel):
    """What every lens has: ``fx``, ``fy`` focal lengths, ``cx``, ``cy`` principal point, pixels, centres at integers."""

    fx: Positive
    fy: Positive
    cx: float
    cy: float

    def project(self, rays: Float64) -> tuple[Float64, Float64]:
        """Pixels (u, v) of rays (..., 3) of any length; NaN where the model has no image."""
        raise NotImplementedError

    def _pixels(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        return self.fx * x + self.cx, self.fy * y + self.cy


class KannalaBrandtLens(_Lens):
    """``r = t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9``, t from the axis."""

    kind: Literal["kannala_brandt"] = "kannala_brandt"
    k: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def project(self, rays: Float64) -> tuple[Float64, Float64]:
        """See the base class."""
        off_axis = np.hypot(rays[..., 0], rays[..., 1])
        t = np.arctan2(off_axis, rays[..., 2])
        t2 = t * t
        k1, k2, k3, k4 = self.k
        r = t * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        scale = r / np.where(off_axis > 0.0, off_axis, 1.0)
        return self._pixels(rays[..., 0] * scale, rays[..., 1] * scale)


class MeiLens(_Lens):
    """The unified sphere: normalise, add ``xi`` to z, divide, distort (radial ``k``, tangential ``p``), apply the camera matrix."""

    kind: Literal["mei"] = "mei"
    xi: Annotated[float, Field(ge=0.0)]
    k: tuple[float, float] = (0.0, 0.0)
    p: tuple[float, float] = (0.0, 0.0)
    skew: float = 0.0

    def project(self, rays: Float64) -> tuple[Float64, Float64]:
        """See the base class."""
        unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        depth = unit[..., 2] + self.xi
        # Past cos t = -1/xi the image folds back on itself.
        seen = (depth > 1e-9) & (1.0 + self.xi * unit[..., 2] > 0.0)
        x, y = (np.where(seen, unit[..., axis] / np.where(seen, depth, 1.0), np.nan) for axis in (0, 1))
        r2 = x * x + y * y
        radial = 1.0 + r2 * (self.k[0] + r2 * self.k[1])
        p1, p2 = self.p
        xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        u, v = self._pixels(xd, yd)
        return u + self.skew * yd, v


class EucmLens(_Lens):
    """``x / (alpha d + (1 - alpha) z)`` with ``d = sqrt(beta (x^2 + y^2) + z^2)``."""

    kind: Literal["eucm"] = "eucm"
    alpha: Annotated[float, Field(ge=0.0, le=1.0)]
    beta: Positive

    def project(self, rays: Float64) -> tuple[Float64, Float64]:
        """See the base class."""
        x, y, z = np.moveaxis(rays, -1, 0)
        d = np.sqrt(self.beta * (x * x + y * y) + z * z)
        depth = self.alpha * d + (1.0 - self.alpha) * z
        w = (1.0 - self.alpha) / self.alpha if self.alpha > 0.5 else self.alpha / max(1.0 - self.alpha, 1e-12)
        seen = (depth > 1e-9 * d) & (z > -w * d)
        safe = np.where(seen, depth, 1.0)
        return self._pixels(np.where(seen, x / safe, np.nan), np.where(seen, y / safe, np.nan))


class DoubleSphereLens(_Lens):
    """Two spheres ``xi`` apart, then a pinhole shifted by ``alpha / (1 - alpha)``."""

    kind: Literal["double_sphere"] = "double_sphere"
    xi: Annotated[float, Field(gt=-1.0, lt=1.0)]
    alpha: Annotated[float, Field(ge=0.0, le=1.0)]

    def project(self, rays: Float64) -> tuple[Float64, Float64]:
        """See the base class."""
        x, y, z = np.moveaxis(rays, -1, 0)
        d1 = np.sqrt(x * x + y * y + z * z)
        shifted = self.xi * d1 + z
        d2 = np.sqrt(x * x + y * y + shifted * shifted)
        depth = self.alpha * d2 + (1.0 - self.alpha) * shifted
        w1 = self.alpha / (1.0 - self.alpha) if self.alpha <= 0.5 else (1.0 - self.alpha) / self.alpha
        w2 = (w1 + self.xi) / np.sqrt(2.0 * w1 * self.xi + self.xi * self.xi + 1.0)
        seen = (z > -w2 * d1) & (depth > 1e-9 * d1)
        safe = np.where(seen, depth, 1.0)
        return self._pixels(np.where(seen, x / safe, np.nan), np.where(seen, y / safe, np.nan))


class OcamLens(StrictModel):
    """OCamCalib: a polynomial from the angle to the radius, and an affine part.

    ``inverse`` are the coefficients of ``world2cam`` in rising order: pixels, of the angle of the ray above the image plane as the
    tool counts it (-90 degrees along the axis). ``affine`` holds the shares of right and down in u, and those in v.
    """

    kind: Literal["ocam"] = "ocam"
    inverse: Annotated[tuple[float, ...], Field(min_length=2)]
    cx: float
    cy: float
    affine: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 1.0)

    def project(self, rays: Float64) -> tuple[Float64, Float64]:
        """Pixels (u, v) of rays (..., 3) of any length; NaN where the model has no image."""
        off_axis = np.hypot(rays[..., 0], rays[..., 1])
        # The tool's z points into the camera.
        angle = np.arctan2(-rays[..., 2], off_axis)
        rho = np.polynomial.polynomial.polyval(angle, np.array(self.inverse))
        scale = rho / np.where(off_axis > 0.0, off_axis, 1.0)
        right, down = rays[..., 0] * scale, rays[..., 1] * scale
        a, b, c, d = self.affine
        return a * right + b * down + self.cx, c * right + d * down + self.cy


Lens = Annotated[
    Union[  # noqa: UP007
        Annotated[KannalaBrandtLens, Tag("Kannala_brandt")],
        Annotated[MeiLens, Tag("Mei")],
        Annotated[EucmLens, Tag("Eucm")],
        Annotated[DoubleSphereLens, Tag("Double_sphere")],
        Annotated[OcamLens, Tag("Ocam")],
    ],
    Discriminator(
        kind_tag,
        custom_error_type="lens_kind",
        custom_error_message="kind must be 'kannala_brandt', 'mei', 'eucm', 'double_sphere' or 'ocam'",
    ),
]


@lru_cache(maxsize=32)
def widest_angle(lens: KannalaBrandtLens | MeiLens | EucmLens | DoubleSphereLens | OcamLens) -> float:
    """Angle from the axis up to which the image grows with the angle, in all directions; beyond it models fold back. Radians."""
    angle = np.radians(np.arange(_STEP_DEG, 180.0, _STEP_DEG))
    around = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    sin, cos = np.sin(angle)[:, None], np.cos(angle)[:, None]
    rays = np.stack(np.broadcast_arrays(sin * np.cos(around), sin * np.sin(around), cos), axis=-1)
    u, v = lens.project(rays)
    radius = np.hypot(u - lens.cx, v - lens.cy)
    grows = np.diff(np.concatenate([np.zeros((1, _DIRECTIONS)), radius]), axis=0) > 0.0
    # Fitted polynomials need not meet the axis exactly.
    grown = grows.all(axis=1) | (angle < math.radians(_NEAR_AXIS_DEG))
    return float(angle[-1] if grown.all() else angle[max(int(np.argmin(grown)) - 1, 0)])
