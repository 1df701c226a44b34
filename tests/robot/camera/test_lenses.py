"""Projections against the formulas as their authors publish them, one ray at a time."""

import math

import numpy as np
import pytest

from panoloc_mcl.robot.camera.lenses import (
    DoubleSphereLens,
    EucmLens,
    KannalaBrandtLens,
    MeiLens,
    OcamLens,
    widest_angle,
)

RAYS = [
    (math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), math.cos(t))
    for t in (0.01, 0.4, 1.0, 1.5, 1.7)
    for a in (0.0, 0.7, 2.0, 3.3, 5.1)
]


def kannala_brandt(ray, fx, fy, cx, cy, k):
    # OpenCV's documentation of fisheye: a = x/z, b = y/z, r^2 = a^2 + b^2, theta = atan(r); past 90 degrees by atan2.
    x, y, z = ray
    theta = math.atan2(math.hypot(x, y), z)
    theta_d = theta * (1 + k[0] * theta**2 + k[1] * theta**4 + k[2] * theta**6 + k[3] * theta**8)
    r = math.hypot(x, y)
    return fx * theta_d * x / r + cx, fy * theta_d * y / r + cy


def mei(ray, xi, fx, fy, cx, cy, k, p, skew):
    x, y, z = (value / math.sqrt(sum(v * v for v in ray)) for value in ray)
    x, y = x / (z + xi), y / (z + xi)
    r2 = x * x + y * y
    xd = x * (1 + k[0] * r2 + k[1] * r2 * r2) + 2 * p[0] * x * y + p[1] * (r2 + 2 * x * x)
    yd = y * (1 + k[0] * r2 + k[1] * r2 * r2) + p[0] * (r2 + 2 * y * y) + 2 * p[1] * x * y
    return fx * xd + skew * yd + cx, fy * yd + cy


def eucm(ray, alpha, beta, fx, fy, cx, cy):
    x, y, z = ray
    rho = math.sqrt(beta * (x * x + y * y) + z * z)
    return fx * x / (alpha * rho + (1 - alpha) * z) + cx, fy * y / (alpha * rho + (1 - alpha) * z) + cy


def double_sphere(ray, xi, alpha, fx, fy, cx, cy):
    x, y, z = ray
    d1 = math.sqrt(x * x + y * y + z * z)
    d2 = math.sqrt(x * x + y * y + (xi * d1 + z) ** 2)
    below = alpha * d2 + (1 - alpha) * (xi * d1 + z)
    return fx * x / below + cx, fy * y / below + cy


def world2cam(ray, inverse, row, column, c, d, e):
    # cam_model_general of OCamCalib's C code: x down the rows, y along the columns, z into the camera.
    x, y, z = ray[1], ray[0], -ray[2]
    norm = math.hypot(x, y)
    theta = math.atan(z / norm)
    rho = sum(coefficient * theta**power for power, coefficient in enumerate(inverse))
    x, y = x / norm * rho, y / norm * rho
    return x * e + y + column, x * c + y * d + row


KB = {"fx": 190.9, "fy": 190.8, "cx": 254.9, "cy": 256.8, "k": (0.0034, 0.0007, -0.002, 0.0002)}
MEI = {"xi": 1.9, "fx": 520.0, "fy": 521.0, "cx": 320.4, "cy": 239.1, "k": (-0.1, 0.02), "p": (0.001, -0.002), "skew": 0.3}
EUCM = {"alpha": 0.63, "beta": 1.04, "fx": 460.0, "fy": 459.0, "cx": 365.8, "cy": 249.3}
DS = {"xi": -0.27, "alpha": 0.56, "fx": 157.9, "fy": 157.8, "cx": 254.9, "cy": 256.8}
INVERSE = (260.0, 150.0, -5.0, 12.0, 6.0, 0.5)


@pytest.mark.parametrize("ray", RAYS)
def test_each_lens_is_its_published_formula(ray) -> None:
    rays = 3.0 * np.array([ray])
    for lens, expected in (
        (KannalaBrandtLens(**KB), kannala_brandt(ray, **KB)),
        (MeiLens(**MEI), mei(ray, **MEI)),
        (EucmLens(**EUCM), eucm(ray, **EUCM)),
        (DoubleSphereLens(**DS), double_sphere(ray, **DS)),
        (
            OcamLens(inverse=INVERSE, cx=382.0, cy=238.0, affine=(1.0, 0.001, 0.002, 0.999)),
            world2cam(ray, INVERSE, 238.0, 382.0, 0.999, 0.002, 0.001),
        ),
    ):
        u, v = lens.project(rays)
        assert u[0] == pytest.approx(expected[0], abs=1e-6), lens.kind
        assert v[0] == pytest.approx(expected[1], abs=1e-6), lens.kind


def test_a_ray_along_the_axis_meets_the_centre() -> None:
    for lens in (KannalaBrandtLens(**KB), MeiLens(**MEI), EucmLens(**EUCM), DoubleSphereLens(**DS)):
        u, v = lens.project(np.array([[0.0, 0.0, 2.0]]))
        assert (u[0], v[0]) == pytest.approx((lens.cx, lens.cy))


def test_beyond_where_a_model_folds_back_nothing_is_seen() -> None:
    # r = t - t^3 / 12 turns round at t = 2.
    lens = KannalaBrandtLens(fx=100.0, fy=100.0, cx=0.0, cy=0.0, k=(-1.0 / 12.0, 0.0, 0.0, 0.0))
    assert math.degrees(widest_angle(lens)) == pytest.approx(math.degrees(2.0), abs=0.6)
    # cos t = -1 / xi.
    assert widest_angle(MeiLens(xi=2.0, fx=100.0, fy=100.0, cx=0.0, cy=0.0)) == pytest.approx(math.acos(-0.5), abs=0.01)
