import numpy as np
import pytest

from panoloc_mcl.tools.evaluation import SequenceRecord


@pytest.fixture
def make_record():
    """Make records by hand: errors along x and in heading, one letter of status a frame (s, c, a, l)."""
    names = {"s": "searching", "c": "converged", "a": "ambiguous", "l": "lost"}

    def make(
        status,
        metres=0.0,
        degrees=0.0,
        *,
        name="noon_00",
        run=0,
        dt=1.0,
        truth_x=0.0,
        with_truth=True,
        kidnapped=(),
        best_place=0,
        step_ms=1.0,
    ):
        n = len(status)
        truth = np.zeros((n, 3))
        truth[:, 0] = truth_x
        poses = truth.copy()
        poses[:, 0] += metres
        poses[:, 2] += np.radians(degrees)
        flags = np.zeros(n, dtype=bool)
        flags[list(kidnapped)] = True
        return SequenceRecord(
            name=name,
            run=run,
            times=100.0 + dt * np.arange(n),
            poses=poses,
            truth=truth if with_truth else None,
            status=tuple(names[letter] for letter in status),
            best_place=np.broadcast_to(best_place, n),
            step_ms=np.broadcast_to(np.asarray(step_ms, dtype=float), n),
            kidnapped=flags,
        )

    return make
