"""What images in a row err by alike: a slowly varying bias of the measured poses, in the state beside the pose.

A pose read off an image errs because the map and the view err, and an image taken a hand's breadth on errs by nearly the same: of the
1.63 mm rms of single images of the rendered hall, 1.62 mm are the same with fresh camera noise. So the measured pose is the true one
plus a bias b, of which successive images know a share: b decays with the way driven (a Gauss-Markov process, as in Gelb, "Applied
Optimal Estimation", section 4.5), and hardly anything is fresh. Pose and bias are correlated after an image; given the pose, the bias
is known to some extent, and what the next image says of the pose is only what this leaves. Standing still, that is nothing; far on,
all of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.estimate import Cluster
from panoloc_mcl.robot.geometry import angle_difference, wrap_angle
from panoloc_mcl.robot.measurement import PoseMeasurement

Float64 = NDArray[np.float64]

# Ways over which errors are alike, in spacings of the references: of the map's (all images among the same sources), and of the view's,
# in position and in heading. Set on the correlation of the errors of single images in one drive a light of the rendered hall, from maps
# with and without disturbed poses.
_WAY_OF_MAP, _WAY_OF_VIEW = 0.75, np.array([0.25, 0.25, 0.6])
# Share of an image's variance that is its own: 1 - (1.62 / 1.63)^2, and a little more.
_FRESH = 0.02
# Squared Mahalanobis distance up to which an image is where the images before led to expect it, in three dimensions: well beyond the
# 16.3 of one normal error in a thousand, as errors have longer tails and an image that is taken for a fresh one counts twice.
_EXPECTED = 30.0
# What an image says at the least, as a share of what it would say alone: keeps matrices regular.
_LEAST = 0.01
# An image that leaves so much of the predicted covariance, in every direction, tells nothing new.
_NEWS = 0.9
# The same view once more only trims what the belief has far out: it counts with so many times its covariance.
_TRIMMING, _WIDE = 4.0, 2.0
# A cluster of equal particles has no volume.
_FLOOR = np.diag([1e-4, 1e-4, 1e-5]) ** 2


class Seen(NamedTuple):
    """A measured pose in the light of the images before.

    Parameters
    ----------
    pose : float64 (3,)
    covariance : float64 (3, 3)
        Of what is new about it.
    bias : ImageBias
        After this image.
    expected : bool
        The images before, and odometry, led to expect it.
    new : bool
        Whether it tells anything.
    """

    pose: Float64
    covariance: Float64
    bias: ImageBias
    expected: bool
    new: bool


@dataclass(frozen=True, eq=False)
class ImageBias:
    """The bias after an image.

    Parameters
    ----------
    pose : float64 (3,)
        That was believed then: metres, radians.
    mean : float64 (3,)
        Measured pose less true one.
    covariance : float64 (3, 3)
    with_pose : float64 (3, 3)
        Covariance of the pose (rows) with the bias (columns).
    """

    pose: Float64
    mean: Float64
    covariance: Float64
    with_pose: Float64

    @classmethod
    def of_first(cls, pose: Float64, covariance: Float64) -> Self:
        """After an image that nothing was known before: what the pose is off, the bias is, the other way."""
        return cls(pose, np.zeros(3), covariance, -covariance)

    def seen(self, cluster: Cluster, pose: Float64, covariance: Float64, kept: Float64) -> Seen:
        """What a measured pose tells that the images before have not.

        Parameters
        ----------
        cluster : Cluster
            The predicted hypothesis.
        pose, covariance : float64 (3,) and (3, 3)
            The measured pose.
        kept : float64 (3,)
            Correlation of its error with that of the image before, of each coordinate.
        """
        before = cluster.covariance + _FLOOR
        mean, bias, with_pose = self._carried(cluster, before, covariance, kept)
        off = _off(pose, cluster.pose) - mean
        # Given the pose, the bias is what it is correlated to, and a rest.
        slope = np.linalg.solve(before, with_pose).T
        rest = _positive(bias - slope @ with_pose) + _FRESH * covariance + _positive(covariance - bias)
        says = np.eye(3) + slope
        innovation = says @ before @ says.T + rest
        if float(off @ np.linalg.solve(innovation + covariance, off)) > _EXPECTED:
            return Seen(pose, covariance, self.of_first(pose, covariance), expected=False, new=True)
        # A linear measurement of the pose: says @ (true - predicted) + rest = off.
        information = says.T @ np.linalg.solve(rest, says) + _LEAST * np.linalg.inv(covariance)
        new_covariance = _symmetric(np.linalg.inv(information))
        new_pose = cluster.pose + new_covariance @ (says.T @ np.linalg.solve(rest, off))
        corrected = _off(new_pose, pose)
        if float(corrected @ np.linalg.solve(bias + covariance, corrected)) > _EXPECTED:
            # The bias explains no correction that large: the predicted covariance is too narrow in some direction.
            return Seen(pose, covariance, self.of_first(pose, covariance), expected=True, new=True)
        gain_pose = np.linalg.solve(innovation, (before + with_pose).T).T
        gain_bias = np.linalg.solve(innovation, (with_pose.T + bias).T).T
        after = ImageBias(
            _wrapped(cluster.pose + gain_pose @ off),
            mean + gain_bias @ off,
            _positive(bias - gain_bias @ innovation @ gain_bias.T),
            with_pose - gain_pose @ innovation @ gain_bias.T,
        )
        left = np.linalg.eigvals(np.linalg.solve(before, before - gain_pose @ innovation @ gain_pose.T)).real
        return Seen(_wrapped(new_pose), new_covariance, after, expected=True, new=bool(left.min() < _NEWS))

    def seen_again(self, cluster: Cluster, pose: Float64, covariance: Float64) -> Seen | None:
        """What a robot that has not moved sees once more: nothing new, unless the belief is far wider; None if it is another view.

        The belief after an image is no normal distribution, so that correlations alone would let it count twice.
        """
        off = _off(pose, self.pose)
        if float(off @ np.linalg.solve(self.covariance + covariance, off)) > _EXPECTED:
            return None
        wide = float(np.trace(cluster.covariance[:2, :2])) > _WIDE * float(np.trace(covariance[:2, :2]))
        return Seen(self.pose, _TRIMMING * covariance, self, expected=True, new=wide)

    def _carried(
        self, cluster: Cluster, before: Float64, covariance: Float64, kept: Float64
    ) -> tuple[Float64, Float64, Float64]:
        """Mean, covariance, and covariance with the pose, after the way to a predicted pose."""
        dx, dy = cluster.pose[:2] - self.pose[:2]
        # An error of the heading swings the whole way round.
        swing = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        both = np.outer(kept, kept)
        bias = both * self.covariance + (1.0 - both) * covariance
        with_pose = swing @ self.with_pose * kept
        # No more correlated than the predicted covariance allows.
        explained = with_pose.T @ np.linalg.solve(before, with_pose)
        excess = float(np.linalg.eigvals(np.linalg.solve(bias, explained)).real.max())
        return kept * self.mean, bias, with_pose / math.sqrt(max(excess / 0.999, 1.0))

    def arrays(self) -> Float64:
        """All of it, float64 (24,)."""
        return np.concatenate([self.pose, self.mean, self.covariance.ravel(), self.with_pose.ravel()])

    @classmethod
    def of_arrays(cls, values: Float64) -> Self:
        """What `arrays` gave.

        Raises
        ------
        ValueError
            Another shape, values that are not finite, or a covariance that is not positive definite.
        """
        if values.shape != (24,) or not np.isfinite(values).all():
            raise ValueError(f"bias of shape {values.shape}, or not finite")
        covariance = values[6:15].reshape(3, 3).copy()
        if float(np.linalg.eigvalsh(covariance).min()) <= 0.0:
            raise ValueError("the covariance of the bias is not positive definite")
        return cls(values[:3].copy(), values[3:6].copy(), covariance, values[15:].reshape(3, 3).copy())


def kept_share(measurement: PoseMeasurement, way: float, spacing: float) -> Float64:
    """Correlation of the errors of two images, of x, y and heading: float64 (3,).

    Parameters
    ----------
    measurement : PoseMeasurement
        Of the second one.
    way : float
        Between them, metres.
    spacing : float
        Of the references, metres.
    """
    whole, of_map, of_frame = (np.diag(part) for part in (measurement.covariance, measurement.of_map, measurement.of_frame))
    frame = np.minimum(of_frame / whole, 1.0)
    of_place = np.minimum(of_map / whole, 1.0 - frame)
    of_view = 1.0 - frame - of_place
    return np.asarray(
        frame + of_place * math.exp(-way / (_WAY_OF_MAP * spacing)) + of_view * np.exp(-way / (_WAY_OF_VIEW * spacing))
    )


def new_share(way: float, spacing: float) -> float:
    """What votes say that is new, after a way in metres: information of a sample that is so correlated with the one before."""
    return math.tanh(0.5 * way / (float(_WAY_OF_VIEW[0]) * spacing))


def _off(pose: Float64, other: Float64) -> Float64:
    off = pose - other
    off[2] = angle_difference(pose[2], other[2])
    return off


def _wrapped(pose: Float64) -> Float64:
    return np.array([pose[0], pose[1], wrap_angle(pose[2])])


def _symmetric(matrix: Float64) -> Float64:
    return 0.5 * (matrix + matrix.T)


def _positive(matrix: Float64) -> Float64:
    """The nearest covariance: negative variances, of rounding or of what is known better already, count as none."""
    values, vectors = np.linalg.eigh(_symmetric(matrix))
    return np.asarray((vectors * np.maximum(values, 1e-14)) @ vectors.T)
