"""Elementary functions without branches or calls.

Why not those of the C library: a loop that calls them runs one particle at a time; of these, the compiler works out four to eight
at once, and a particle filter lives on sine, cosine, logarithm and exponential. They also give the same bits whatever library a
machine has. The polynomials are those of fdlibm (Sun Microsystems, 1993). Everything is float64; arguments come from the filter, so
the far ends of the number range are left out (each function says so).
"""

from __future__ import annotations

import numpy as np

from panoloc_mcl.robot.kernels.jit import inlined

_TWO_OVER_PI = 0.6366197723675814
# Pi / 2 and ln 2 in two parts: whole multiples of the first are exact.
_HALF_PI_HIGH, _HALF_PI_LOW = 1.57079632673412561417e00, 6.07710050650619224932e-11
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_SQRT2 = 1.4142135623730951
_LOG2_E = 1.44269504088896338700e00
# Added to a float64 below 2^51 in size, it leaves the nearest whole number in the last bits.
_TO_WHOLE = 1.5 * 2.0**52
_ONE = 0x3FF0000000000000
_LEAST_EXPONENT = -708.0


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
def small_whole(number: np.uint64) -> float:
    """A whole number below 2^52 as float64: by its bits, because few processors convert several 64-bit numbers at once."""
    return np.uint64(number | np.uint64(0x4330000000000000)).view(np.float64) - 2.0**52


@inlined
def logarithm(x: float) -> float:
    """``log(x)`` of positive normal numbers, to 1e-15 (of its value, near 1 absolutely); garbage of anything else."""
    bits = np.float64(x).view(np.uint64)
    e = small_whole(bits >> np.uint64(52)) - 1023.0
    m = np.uint64((bits & np.uint64(0x000FFFFFFFFFFFFF)) | np.uint64(0x3FF0000000000000)).view(np.float64)
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


@inlined
def exponential(x: float) -> float:
    """``exp(x)`` of numbers up to 709, to 1e-15 of its value; 0 below -708, where a float64 begins to lose digits."""
    shifted = x * _LOG2_E + _TO_WHOLE
    e = shifted - _TO_WHOLE
    hi, lo = x - e * _LN2_HIGH, e * _LN2_LOW
    r = hi - lo
    z = r * r
    p = -2.77777777770155933842e-03 + z * (
        6.61375632143793436117e-05 + z * (-1.65339022054652515390e-06 + z * 4.13813679705723846039e-08)
    )
    c = r - z * (1.66666666666666019037e-01 + z * p)
    y = 1.0 + (r * c / (2.0 - c) - lo + hi)
    # Two to the power of e, by its bits: the whole number moves into the exponent, and what lies above it out of the number.
    power = np.uint64((np.float64(shifted).view(np.uint64) << np.uint64(52)) + np.uint64(_ONE)).view(np.float64)
    return 0.0 if x < _LEAST_EXPONENT else y * power
