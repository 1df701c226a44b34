"""Elementary functions without branches or calls, in single precision.

Why not those of the C library: a loop that calls them runs one particle at a time; of these, the compiler works out eight at once, and
a particle filter lives on sine, cosine, logarithm and exponential. They also give the same bits whatever library a machine has. The
polynomials are those of Cephes (Moshier 1989), good to about 1e-7: a particle's noise needs no more. Arguments come from the filter,
so the far ends of the number range are left out (each function says so).
"""

from __future__ import annotations

import numpy as np

from panoloc_mcl.robot.kernels.jit import inlined

# Of single precision, or all that they meet would be of double.
_HALF, _ONE, _LN2 = np.float32(0.5), np.float32(1.0), np.float32(np.log(2.0))
_SINE = (np.float32(-1.6666654611e-1), np.float32(8.3321608736e-3), np.float32(-1.9515295891e-4))
_COSINE = (np.float32(4.166664568298827e-2), np.float32(-1.388731625493765e-3), np.float32(2.443315711809948e-5))
_LOGARITHM = (
    np.float32(3.3333331174e-1), np.float32(-2.4999993993e-1), np.float32(2.0000714765e-1),
    np.float32(-1.6668057665e-1), np.float32(1.4249322787e-1), np.float32(-1.2420140846e-1),
    np.float32(1.1676998740e-1), np.float32(-1.1514610310e-1), np.float32(7.0376836292e-2),
)  # fmt: skip
_EXPONENTIAL = (
    np.float32(5.0000001201e-1), np.float32(1.6666665459e-1), np.float32(4.1665795894e-2),
    np.float32(8.3334519073e-3), np.float32(1.3981999507e-3), np.float32(1.9875691500e-4),
)  # fmt: skip
_RADIANS = np.float32(0.5 * np.pi / 2.0**30)
# Bits of sqrt(1/2): a mantissa is taken between this and its double.
_LEAST_MANTISSA = 0x3F3504F3
_LOG2_E = np.float32(1.0 / np.log(2.0))
# Ln 2 in two parts: whole multiples of the first are exact.
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)
_LEAST_EXPONENT, _NOTHING = np.float32(-87.0), np.float32(0.0)
# Of arctan(t) = t P(t^2) on [0, 1], by iteratively reweighted least squares.
_ARCTANGENT = (
    np.float32(9.9999933557e-1), np.float32(-3.3329860750e-1), np.float32(1.9946565253e-1), np.float32(-1.3908627540e-1),
    np.float32(9.6421921481e-2), np.float32(-5.5912255611e-2), np.float32(2.1862908263e-2), np.float32(-4.0545534169e-3),
)  # fmt: skip
_PI, _HALF_PI, _TINY = np.float32(np.pi), np.float32(0.5 * np.pi), np.float32(1e-30)


@inlined
def sine_cosine(turn: np.uint32) -> tuple[np.float32, np.float32]:
    """Sine and cosine, float32, of a whole number of 2^-32 of a turn."""
    # Back to 32 bits after every step: the compiler then works on twice as many at once as in 64.
    shifted = np.uint32((np.uint64(turn) + np.uint64(0x20000000)) & np.uint64(0xFFFFFFFF))
    quarter = np.uint32(shifted >> np.uint32(30))
    # From the middle of the quarter: at most an eighth of a turn to either side.
    part = np.int32(np.int32(shifted & np.uint32(0x3FFFFFFF)) - np.int32(0x20000000))
    r = np.float32(part) * _RADIANS
    z = r * r
    s = r + r * z * (_SINE[0] + z * (_SINE[1] + z * _SINE[2]))
    c = _ONE - _HALF * z + z * z * (_COSINE[0] + z * (_COSINE[1] + z * _COSINE[2]))
    odd = np.uint32(quarter & np.uint32(1)) != np.uint32(0)
    sine, cosine = (c, s) if odd else (s, c)
    sine_sign = np.uint32((quarter & np.uint32(2)) << np.uint32(30))
    cosine_sign = np.uint32(((quarter + np.uint32(1)) & np.uint32(2)) << np.uint32(30))
    sine = np.uint32(np.float32(sine).view(np.uint32) ^ sine_sign).view(np.float32)
    cosine = np.uint32(np.float32(cosine).view(np.uint32) ^ cosine_sign).view(np.float32)
    return sine, cosine


@inlined
def logarithm(x: np.float32) -> np.float32:
    """``log(x)`` of positive normal float32 numbers, to 1e-7 (of its value, near 1 absolutely); garbage of anything else."""
    bits = np.int32(np.float32(x).view(np.int32) - np.int32(_LEAST_MANTISSA))
    e = np.float32(np.int32(bits >> np.int32(23)))
    m = np.int32((bits & np.int32(0x007FFFFF)) + np.int32(_LEAST_MANTISSA))
    r = np.int32(m).view(np.float32) - _ONE
    p = _LOGARITHM[8]
    for k in range(7, -1, -1):
        p = p * r + _LOGARITHM[k]
    return e * _LN2 + (r + r * r * (r * p - _HALF))


@inlined
def exponential(x: np.float32) -> np.float32:
    """``exp(x)`` of float32 numbers up to 88, to 2e-7 of its value; 0 below -87, where a float32 begins to lose digits."""
    small = x < _LEAST_EXPONENT
    e = np.floor((_LEAST_EXPONENT if small else x) * _LOG2_E + _HALF)
    r = (x - e * _LN2_HIGH) - e * _LN2_LOW
    p = _EXPONENTIAL[5]
    for k in range(4, -1, -1):
        p = p * r + _EXPONENTIAL[k]
    power = np.int32(np.int32(np.int32(e) + np.int32(127)) << np.int32(23)).view(np.float32)
    return _NOTHING if small else (p * (r * r) + r + _ONE) * power


@inlined
def arctan2(y: np.float32, x: np.float32) -> np.float32:
    """Angle of a vector, float32, within 5e-7 radians; vectors shorter than 1e-30 have none."""
    ax, ay = abs(x), abs(y)
    ratio = min(ax, ay) / max(max(ax, ay), _TINY)
    q = ratio * ratio
    angle = _ARCTANGENT[7]
    for k in range(6, -1, -1):
        angle = angle * q + _ARCTANGENT[k]
    angle *= ratio
    angle = _HALF_PI - angle if ay > ax else angle
    angle = _PI - angle if x < _NOTHING else angle
    return -angle if y < _NOTHING else angle
