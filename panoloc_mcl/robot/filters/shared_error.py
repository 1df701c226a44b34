"""What images in a row err by alike: a measured pose counts for what it tells that the belief has not been told.

A pose read off an image errs because the map and the view err, and an image taken a hand's breadth on errs by nearly the same: of the
1.63 mm rms of single images of the rendered hall, 1.62 mm are the same with fresh camera noise. Part of the belief's covariance comes
from such errors, and part of an image's is shared with them, the less the farther the way between (a first-order Gauss-Markov
process). How the shared parts are correlated in detail, after prediction, resampling and many images, is not kept: belief and image are
fused so that the result holds however they are (split covariance intersection, Julier & Uhlmann 2001). Standing still, an image then
tells nothing new; after a long way, or where the belief is wide, all that it would alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.filters.estimate import Cluster
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.measurement import PoseMeasurement

Float64 = NDArray[np.float64]

# Ways over which errors are alike, in spacings of the references: of the map's (all images among the same sources), and of the view's,
# in position and in heading. Set on the correlation of the errors of single images in one drive a light of the rendered hall, from maps
# with and without disturbed poses.
_WAY_OF_MAP, _WAY_OF_VIEW = 0.75, np.array([0.25, 0.25, 0.6])
# Share of an image's variance that is its own: 1 - (1.62 / 1.63)^2, and a little more.
_FRESH = 0.02
# Squared Mahalanobis distance up to which an image is where the belief led to expect it: of one in a thousand, in three dimensions.
_EXPECTED = 16.3
# An image that leaves so much of the predicted covariance, in every direction, tells nothing new.
_NEWS = 0.9
# The same view once more only trims what the belief has far out, with so many times its covariance at the least: the belief's bulk
# holds the image already, and no normal distribution says so. And with so little of its information where the belief is no wider.
_TRIMMING, _LEAST_TRIMMING = 4.0, 1e-3
# Weights of the belief against the image that are tried; the rest is the image's.
_WEIGHTS = np.linspace(0.02, 0.98, 25)[:, None, None]
# A cluster of equal particles has no volume.
_FLOOR = np.diag([1e-4, 1e-4, 1e-5]) ** 2


class Seen(NamedTuple):
    """A measured pose in the light of the belief.

    Parameters
    ----------
    covariance : float64 (3, 3)
        That it counts with.
    widening : float64 (3, 3)
        By how much the belief is to be wider before it counts.
    shared : SharedError
        After this image.
    new : bool
        Whether it tells anything.
    """

    covariance: Float64
    widening: Float64
    shared: SharedError
    new: bool


@dataclass(frozen=True, eq=False)
class SharedError:
    """What of the belief's covariance comes from errors that the next image may share.

    Parameters
    ----------
    pose : float64 (3,)
        That was believed at the last image: metres, radians.
    covariance : float64 (3, 3)
    """

    pose: Float64
    covariance: Float64

    def seen(self, cluster: Cluster, pose: Float64, covariance: Float64, kept: Float64) -> Seen:
        """What a measured pose tells that the belief has not been told.

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
        off = pose - cluster.pose
        off[2] = angle_difference(pose[2], cluster.pose[2])
        if float(off @ np.linalg.solve(before + covariance, off)) > _EXPECTED:
            # Somewhere else: nothing that was believed there is shared.
            return Seen(covariance, np.zeros((3, 3)), SharedError(pose, covariance), new=True)
        # What has become of the error that was shared since is the belief's own.
        theirs = self._carried(cluster, before) * np.outer(kept, kept)
        ours_shared, ours_own = (1.0 - _FRESH) * covariance, _FRESH * covariance
        # Each shared part as wide as its weight asks for: then the sum holds however they are correlated.
        beliefs, images = theirs / _WEIGHTS + (before - theirs), ours_shared / (1.0 - _WEIGHTS) + ours_own
        information = np.linalg.inv(beliefs) + np.linalg.inv(images)
        best = int(np.argmax(np.linalg.slogdet(information)[1]))
        after, told, said = (np.linalg.inv(part[best]) for part in (information, beliefs, images))
        stands = bool(np.all(kept >= 1.0))
        wider, directions = _against(before, covariance)
        if float(np.linalg.eigvals(np.linalg.solve(before, after)).real.min()) > _NEWS or (
            stands and wider.max() * _NEWS <= 1.0
        ):
            return Seen(covariance, np.zeros((3, 3)), SharedError(cluster.pose, _positive(theirs)), new=False)
        gain, rest = after @ said, after @ told
        independent = rest @ (before - theirs) @ rest.T + gain @ ours_own @ gain.T
        shared = SharedError(cluster.pose + gain @ off, _positive(after - independent))
        if stands:
            # In each direction, a belief that is a little wider than the image becomes as wide, and never surer than one look.
            told = np.clip(1.0 - 1.0 / wider, _LEAST_TRIMMING, 1.0 / _TRIMMING)
            return Seen((directions / told) @ directions.T, np.zeros((3, 3)), shared, new=True)
        return Seen(images[best], _positive(beliefs[best] - before), shared, new=True)

    def _carried(self, cluster: Cluster, before: Float64) -> Float64:
        """The shared part of the covariance after the way to a predicted pose, and no more than that has in all."""
        dx, dy = cluster.pose[:2] - self.pose[:2]
        # An error of the heading swings the whole way round.
        swing = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        shared = swing @ self.covariance @ swing.T
        # Per direction: of what the belief has there, as much as is shared.
        values, directions = _against(shared, before)
        return np.asarray((directions * np.clip(values, 1e-9, 1.0 - 1e-9)) @ directions.T)

    def arrays(self) -> Float64:
        """All of it, float64 (12,)."""
        return np.concatenate([self.pose, self.covariance.ravel()])

    @classmethod
    def of_arrays(cls, values: Float64) -> Self:
        """What `arrays` gave.

        Raises
        ------
        ValueError
            Another shape, values that are not finite, or a covariance that is not positive definite.
        """
        if values.shape != (12,) or not np.isfinite(values).all():
            raise ValueError(f"shared error of shape {values.shape}, or not finite")
        covariance = values[3:].reshape(3, 3).copy()
        if float(np.linalg.eigvalsh(covariance).min()) <= 0.0:
            raise ValueError("the covariance of the shared error is not positive definite")
        return cls(values[:3].copy(), covariance)


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


def _against(covariance: Float64, other: Float64) -> tuple[Float64, Float64]:
    """Directions (columns, float64 (3, 3)) in which both vary independently, ``other`` by 1, and how much the first one does (3,)."""
    root = np.linalg.cholesky(other)
    values, vectors = np.linalg.eigh(_symmetric(np.linalg.solve(root, np.linalg.solve(root, covariance).T)))
    return values, root @ vectors


def _symmetric(matrix: Float64) -> Float64:
    return 0.5 * (matrix + matrix.T)


def _positive(matrix: Float64) -> Float64:
    """The nearest covariance: negative variances, of rounding or of what is known better already, count as none."""
    values, vectors = np.linalg.eigh(_symmetric(matrix))
    return np.asarray((vectors * np.maximum(values, 1e-14)) @ vectors.T)
