"""Elementary functions without branches or calls.

Why not those of the C library: a loop that calls them runs one particle at a time; of these, the compiler works out four to eight
at once, and a particle filter lives on sine, cosine and logarithm. They also give the same bits whatever library a
machine has. The polynomials are those of fdlibm (Sun Microsystems, 1993). Everything is float64; arguments come from the filter, so
the far ends of the number range are left out (each function says so).
"""

from __future__ import annotations

import numpy as np

from panoloc_mcl.kernels.jit import inlined

_TWO_OVER_PI = 0.6366197723675814
# Pi / 2 and ln 2 in two parts: whole multiples of the first are exact.
_HALF_PI_HIGH, _HALF_PI_LOW = 1.57079632673412561417e00, 6.07710050650619224932e-11
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_SQRT2 = 1.4142135623730951


@inlined
def sine_cosine(angle: float) -> tuple[float, float]:
    """Sine and cosine of radians within some thousand turns, to 1e-15; NaN of what is not finite."""
    quarters = np.floor(angle * _TWO_OVER_PI + 0.5)
    r = (angle - quarters * _HALF_PI_HIGH) - quarters * _HALF_PI_LOW
    z = r * r
    s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)
    s = r + r * z * (-1.66666666666666324348e-01 + z * s)
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
    c = 4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c))
    c = 1.0 - 0.5 * z + z * z * c
    # What quarter of the circle, as a float: conversions would cost more than they save.
    halves = np.floor(0.5 * quarters)
    odd = quarters != 2.0 * halves
    sign = 1.0 if halves == 2.0 * np.floor(0.5 * halves) else -1.0
    return sign * (c if odd else s), sign * (-s if odd else c)


@inlined
def logarithm(x: float) -> float:
    """``log(x)`` of positive normal numbers, to 1e-15 (of its value, near 1 absolutely); garbage of anything else."""
    bits = np.float64(x).view(np.int64)
    e = np.float64((bits >> 52) - 1023)
    m = np.int64((bits & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000).view(np.float64)
    big = m > _SQRT2
    m = 0.5 * m if big else m
    e = e + 1.0 if big else e
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    p = 1.531383769920937332e-01 + z * 1.479819860511658591e-01
    p = 2.222219843214978396e-01 + z * (1.818357216161805012e-01 + z * p)
    p = 6.666666666666735130e-01 + z * (3.999999999940941908e-01 + z * (2.857142874366239149e-01 + z * p))
    return e * _LN2_HIGH + (f + (e * _LN2_LOW - s * (f - z * p)))
