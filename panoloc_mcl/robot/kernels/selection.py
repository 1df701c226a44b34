"""The smallest of many numbers by counting, without sorting."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.kernels.jit import kernel

Int32 = NDArray[np.int32]
UInt8 = NDArray[np.uint8]

# Bits of the float32.
_INFINITY = 0x7F800000


@kernel
def limit_of_smallest(bits: Int32, wanted: int, guess: int) -> tuple[int, int]:
    """Find what separates the ``wanted`` smallest of non-negative numbers from the others, by counting.

    Non-negative floats are in the order of their bits, so this is a bisection over integers, started near a guess. Counting is
    vector code; a partial sort takes several times as long.

    Parameters
    ----------
    bits : int32 (n,)
        Bits of non-negative float32 numbers.
    wanted : int
        1..n.
    guess : int
        Where to look first, such as the limit of similar numbers.

    Returns
    -------
    limit : int
    ties : int
        The smallest are those at most ``limit``, and as many as ``ties`` of those equal to ``limit + 1``.
    """
    low, high, below = -1, 0x7FFFFFFF, 0
    probe, step = guess, 1 << 19
    rose = fell = False
    while high - low > 1:
        count = count_up_to(bits, np.int32(probe))
        if count == wanted:
            return probe, 0
        if count > wanted:
            high, fell = probe, True
        else:
            low, below, rose = probe, count, True
        if rose and fell:
            probe = (low + high) >> 1
        else:
            probe = min(high - 1, low + step) if rose else max(low + 1, high - step)
            step *= 4
    return low, wanted - below


@kernel
def count_up_to(bits: Int32, limit: np.int32) -> int:
    """How many of int32 (n,) numbers are at most ``limit``."""
    count = np.int32(0)
    for i in range(bits.shape[0]):
        # In 32 bits, twice as many fit a vector.
        count = np.int32(count + (bits[i] <= limit))
    return int(count)


@kernel
def leave_out(bits: Int32, limit: int, ties: int, rows: Int32) -> int:
    """List all but the smallest.

    Parameters
    ----------
    bits : int32 (n,)
        Bits of float32 numbers; infinity stands for what was left out before and is not listed again.
    limit, ties : int
        See `limit_of_smallest`.
    rows : int32 (n + 1,)
        Takes their indices, in order.

    Returns
    -------
    int
        How many.
    """
    count = 0
    if ties == 0:
        for i in range(bits.shape[0]):
            # Written always and counted sometimes: a branch that nobody can predict costs more.
            rows[count] = i
            count += (bits[i] > limit) & (bits[i] < _INFINITY)
        return count
    for i in range(bits.shape[0]):
        if bits[i] == limit + 1 and ties > 0:
            ties -= 1
        elif limit < bits[i] < _INFINITY:
            rows[count] = i
            count += 1
    return count


@kernel
def remaining(gone: UInt8, rows: Int32) -> int:
    """List where ``gone`` (n,) is 0 in ``rows`` (n + 1,), and return how many."""
    count = 0
    for i in range(gone.shape[0]):
        rows[count] = i
        count += gone[i] == 0
    return count
