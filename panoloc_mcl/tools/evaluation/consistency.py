"""Whether claimed covariances hold: errors against what was claimed of them.

NEES is the normalised estimation error squared, e' C^-1 e (Bar-Shalom, Li & Kirubarajan, "Estimation with Applications to Tracking and
Navigation", section 5.4). Of errors that are normal and as large as claimed it is chi-squared distributed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from panoloc_mcl.robot.geometry import FloatArray

#: What there is where nothing was claimed.
NOTHING: dict[str, Any] = {"nees_median": None, "inside_1sd": None, "inside_2sd": None, "inside_3sd": None}


def consistency(errors: FloatArray, covariances: FloatArray) -> dict[str, dict[str, Any]]:
    """How errors compare with the covariances that were claimed for them.

    Parameters
    ----------
    errors : float64 (n, 3)
        Estimated pose less true one: metres, metres, radians in (-pi, pi].
    covariances : float64 (n, 3, 3)
        Rows that are not finite, or not positive definite, claim nothing and are left out.

    Returns
    -------
    dict
        ``position`` (two dimensions) and ``heading`` (one), each with ``nees_median``, the median of the NEES over that of the
        chi-squared distribution (1 is right, more is too sure), and ``inside_1sd``, ``inside_2sd``, ``inside_3sd``, shares of errors
        within so many claimed standard deviations (of normal errors 39.3, 86.5 and 98.9 % in two dimensions; 68.3, 95.4 and 99.7 %
        in one). None where nothing is claimed.
    """
    return {
        "position": _held(*_valid(errors[:, :2], covariances[:, :2, :2])),
        "heading": _held(*_valid(errors[:, 2:], covariances[:, 2:, 2:])),
    }


def _valid(errors: FloatArray, covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
    finite = np.isfinite(errors).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    errors, covariances = errors[finite], covariances[finite]
    definite = np.linalg.eigvalsh(covariances).min(axis=1) > 0.0 if len(covariances) else np.zeros(0, dtype=np.bool_)
    return errors[definite], covariances[definite]


def _held(errors: FloatArray, covariances: FloatArray) -> dict[str, Any]:
    if not len(errors):
        return dict(NOTHING)
    # Here, since a robot that runs does not need it.
    from scipy.stats import chi2

    nees = np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])
    return {
        "nees_median": float(np.median(nees) / chi2.median(errors.shape[1])),
        **{f"inside_{count}sd": float(np.mean(nees <= count**2)) for count in (1, 2, 3)},
    }
