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

from panoloc_mcl.robot.kernels.elementary import logarithm, sine_cosine
from panoloc_mcl.robot.kernels.jit import inlined, vector_kernel

Float32 = NDArray[np.float32]
UInt32 = NDArray[np.uint32]
# A 32-bit word; the compiler multiplies vectors of these only if they are held in 64 bits.
Word = np.uint64

_WORD = 0xFFFFFFFF
_HALF, _OF_31_BITS, _MINUS_TWO = np.float32(0.5), np.float32(2.0**-31), np.float32(-2.0)


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
def normal_pair(one: np.uint32, other: np.uint32) -> tuple[np.float32, np.float32]:
    """Two standard normal float32 numbers of two random 32-bit words (Box & Muller 1958); none is beyond 6.7."""
    # Half a step up, so that no logarithm is of zero; of 31 bits, because few processors convert the 32nd.
    radius = np.sqrt(_MINUS_TWO * logarithm((np.float32(np.int32(one >> np.uint32(1))) + _HALF) * _OF_31_BITS))
    s, c = sine_cosine(other)
    return radius * c, radius * s


@vector_kernel
def words_of(key: int, step: int, stream: int, first: int, count: int, out: UInt32) -> UInt32:
    """Four random words for each of ``count`` particles, into the first columns of uint32 (4, m), which is returned; see `normals`."""
    word = np.uint64(_WORD)
    k0, k1 = np.uint64(key) & word, np.uint64(key) >> np.uint64(32)
    for i in range(count):
        index = np.uint64(first + i)
        w0, w1, w2, w3 = philox(index & word, index >> np.uint64(32), np.uint64(step), np.uint64(stream), k0, k1)
        out[0, i], out[1, i], out[2, i], out[3, i] = np.uint32(w0), np.uint32(w1), np.uint32(w2), np.uint32(w3)
    return out


@vector_kernel
def normal_pairs(one: UInt32, other: UInt32, first: Float32, second: Float32, count: int) -> None:
    """Standard normal numbers of ``count`` pairs of words (m,), into two float32 (m,)."""
    for i in range(count):
        first[i], second[i] = normal_pair(one[i], other[i])


@vector_kernel
def normals(key: int, step: int, stream: int, first: int, count: int) -> Float32:
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
    float32 (4, count)
    """
    words, out = (
        words_of(key, step, stream, first, count, np.empty((4, count), dtype=np.uint32)),
        np.empty((4, count), np.float32),
    )
    normal_pairs(words[0], words[1], out[0], out[1], count)
    normal_pairs(words[2], words[3], out[2], out[3], count)
    return out
