"""Random numbers that are a function of (key, step, particle) and of nothing else: Philox4x32-10.

A generator that is advanced from draw to draw gives a particle other numbers when particles before it come or go, or are worked on
by another thread. Here every particle has a counter of its own, so the result is the same to the last bit with any number of
threads, and a filter is restored from its key and step alone. Philox is the counter-based generator of Salmon, Moraes, Dror & Shaw,
"Parallel random numbers: as easy as 1, 2, 3" (2011); it passes BigCrush, and is held against the published known answers in the tests.

One counter gives four 32-bit words, which is just what the motion of one particle needs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.elementary import logarithm, sine_cosine, small_whole
from panoloc_mcl.robot.kernels.jit import inlined, vector_kernel

Float64 = NDArray[np.float64]
# A 32-bit word; the compiler multiplies vectors of these only if they are held in 64 bits.
Word = np.uint64

_WORD = 0xFFFFFFFF
_TURN = 2.0 * np.pi / 2.0**32


@inlined
def philox(c0: Word, c1: Word, c2: Word, c3: Word, k0: Word, k1: Word) -> tuple[Word, Word, Word, Word]:
    """Ten rounds of Philox4x32: four random 32-bit words of a counter of four and a key of two.

    Parameters
    ----------
    c0, c1, c2, c3, k0, k1 : uint64
        Below 2^32.
    """
    word, shift = np.uint64(_WORD), np.uint64(32)
    for _ in range(10):
        one, other = c0 * np.uint64(0xD2511F53), c2 * np.uint64(0xCD9E8D57)
        c0, c1, c2, c3 = (other >> shift) ^ c1 ^ k0, other & word, (one >> shift) ^ c3 ^ k1, one & word
        k0, k1 = (k0 + np.uint64(0x9E3779B9)) & word, (k1 + np.uint64(0xBB67AE85)) & word
    return c0, c1, c2, c3


@inlined
def normal_pair(one: Word, other: Word) -> tuple[float, float]:
    """Two standard normal numbers of two random 32-bit words (Box & Muller 1958); none is beyond 6.8."""
    # Half a step up, so that no logarithm is of zero.
    radius = np.sqrt(-2.0 * logarithm((small_whole(one) + 0.5) * 2.0**-32))
    s, c = sine_cosine(small_whole(other) * _TURN)
    return radius * c, radius * s


@vector_kernel
def normals(key: int, step: int, stream: int, first: int, count: int) -> Float64:
    """Four standard normal numbers for each of ``count`` particles.

    Parameters
    ----------
    key : int
        Below 2^63.
    step, stream : int
        Below 2^32: when, and what for.
    first : int
        Index of the first particle.
    count : int

    Returns
    -------
    float64 (4, count)
    """
    out = np.empty((4, count))
    word = np.uint64(_WORD)
    k0, k1 = np.uint64(key) & word, np.uint64(key) >> np.uint64(32)
    for i in range(count):
        index = np.uint64(first + i)
        w0, w1, w2, w3 = philox(index & word, index >> np.uint64(32), np.uint64(step), np.uint64(stream), k0, k1)
        out[0, i], out[1, i] = normal_pair(w0, w1)
        out[2, i], out[3, i] = normal_pair(w2, w3)
    return out
