"""What can go wrong with a sequence of frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def drop_frames(count: int, rng: np.random.Generator, share: float) -> NDArray[np.int64]:
    """Frames that are left when a share of them is lost.

    Parameters
    ----------
    count : int
        Frames of the sequence.
    rng : Generator
    share : float
        Of the frames, in [0, 1]; rounded to whole frames.

    Returns
    -------
    int64 (n,)
        Ascending indices.
    """
    lost = round(share * count)
    return np.sort(rng.permutation(count)[lost:]).astype(np.int64)
