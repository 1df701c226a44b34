"""Localization by structure, as hloc and COLMAP do it.

J. L. Schoenberger & J.-M. Frahm, "Structure-from-motion revisited", CVPR 2016 (COLMAP); P.-E. Sarlin, C. Cadena, R. Siegwart &
M. Dymczyk, "From coarse to fine: robust hierarchical localization at large scale", CVPR 2019 (hloc). The map is points of the world,
triangulated from features of the references at their known poses. An image's features are matched with those of every reference, the
references that most of them fit are kept, their matches become pairs of a pixel and a point, and the pose is that of P3P in LO-RANSAC
(Chum, Matas & Kittler 2003), refined over its inliers: six degrees of freedom, of which x, y and heading are the answer.

Decided here: COLMAP's EQUIRECTANGULAR camera, so that the panorama is one image (nothing is cut into perspective views); references are
ranked by matches and not by a descriptor of whole images, which costs time and misses none; an answer needs ``min_inliers``, else there
is none. Votes are a bump around the answer, as the particle filter wants a field.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.peers.base import Float32, Peer, image_problem
from panoloc_mcl.laboratory.peers.local_features.kinds import Features, Found, Sift, XFeat, found_in
from panoloc_mcl.laboratory.peers.local_features.sphere import Sphere, pose_on_plane, pycolmap
from panoloc_mcl.laboratory.peers.local_features.triangulation import triangulate
from panoloc_mcl.laboratory.peers.settings import ColmapSiftSettings, StructureSettings, XFeatSettings
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.observation.base import Arrays
from panoloc_mcl.robot.observation.field import VoteField, silent_field
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.references import ReferencePanoramas

Float64 = NDArray[np.float64]

# Of the bump around the answer, degrees.
_BUMP_DEG = 10.0


@dataclass(frozen=True, eq=False)
class Located:
    """A pose from points.

    Parameters
    ----------
    pose : float64 (3,)
    covariance : float64 (3, 3)
    inliers : int
    share : float
        Of the pairs of pixels and points that are inliers.
    """

    pose: Float64
    covariance: Float64
    inliers: int
    share: float


class StructurePeer(Peer[StructureSettings]):
    """What kinds of features share."""

    def __init__(self, references: ReferencePanoramas, settings: StructureSettings, arrays: Arrays) -> None:
        super().__init__(references, settings, arrays)
        self._sphere = Sphere(references.geometry, settings.width)
        self._camera = self._sphere.camera()
        self._features = self.features(settings)
        ends = np.cumsum(self._arrays["counts"])[:-1]
        self._found = [
            Found(*parts)
            for parts in zip(
                np.split(self._arrays["features"].astype(np.float64), ends),
                np.split(self._arrays["descriptors"].astype(np.float32), ends),
                strict=True,
            )
        ]
        self._point_of = np.split(self._arrays["point_of"], ends)

    @staticmethod
    @abstractmethod
    def features(settings: Any) -> Features:
        """The kind of features."""

    @classmethod
    def learn(
        cls, images: Float32, references: ReferencePanoramas, settings: StructureSettings, progress: Progress
    ) -> dict[str, NDArray[Any]]:
        """Features of the references, and the points that they show."""
        sphere, features = Sphere(references.geometry, settings.width), cls.features(settings)
        found = []
        for index, pixels in enumerate(references.pixels):
            valid = None if references.valid is None else references.valid[index]
            found.append(found_in(pixels.astype(np.float32), valid, features, sphere))
            progress(index + 1, len(references.pixels), "features")
        points, point_of = triangulate(found, references.positions, sphere, features, settings.neighbours, progress)
        return {
            "points": points,
            "counts": np.array([len(part.points) for part in found], dtype=np.int64),
            "features": np.concatenate([part.points for part in found]).astype(np.float32),
            "descriptors": np.concatenate([part.descriptors for part in found]).astype(np.float16),
            "point_of": np.concatenate(point_of).astype(np.int32),
        }

    def votes(self, image: Float32) -> Float32:
        """Votes around the answer; none where there is no answer."""
        located = self.locate(Panorama(image))
        return np.zeros((self._columns, len(self.places)), dtype=np.float32) if located is None else self._bump(located)

    def observe(self, panorama: Panorama, headings: Float64 | None = None) -> VoteField:
        """The answer, and votes around it (see `ObservationModel.observe`)."""
        asked = self._headings if headings is None else np.asarray(headings, dtype=np.float64)
        problem = image_problem(np.asarray(panorama.pixels, dtype=np.float32))
        located = None if problem else self.locate(panorama)
        if located is None:
            problem = problem or f"fewer than {self.settings.min_inliers} points of the map agree on a pose"
            return silent_field(asked, self.places, problem, headings is None)
        measurement = PoseMeasurement(
            located.pose, located.covariance, np.zeros(2), Agreement(located.share, np.full(1, located.share), located.share)
        )
        votes = self._bump(located, asked)
        return VoteField(votes, asked, self.places, self.settings.tolerance, headings is None, measurement=measurement)

    def locate(self, panorama: Panorama) -> Located | None:
        """The pose of an image; None where too few points agree."""
        mine = found_in(panorama.pixels, panorama.valid, self._features, self._sphere)
        alike = [len(self._features.likely(mine.descriptors, other.descriptors)) for other in self._found]
        chosen = np.argsort(alike, kind="stable")[::-1][: self.settings.candidates]
        pairs = []
        for index in chosen:
            if alike[index]:
                matches = self._features.matched(mine, self._found[index], self._sphere)
                shown = self._point_of[index][matches[:, 1]]
                pairs.append(np.column_stack([matches[:, 0], shown])[shown >= 0])
        pooled = np.unique(np.concatenate(pairs), axis=0) if pairs else np.zeros((0, 2), dtype=np.int64)
        return self._pose(mine.points[pooled[:, 0]], self._arrays["points"][pooled[:, 1]])

    def _pose(self, pixels: Float64, points: Float64) -> Located | None:
        if len(pixels) < max(self.settings.min_inliers, 4):
            return None
        options = pycolmap().AbsolutePoseEstimationOptions()
        options.ransac.max_error = self.settings.max_error_px
        options.ransac.random_seed = 0
        found = pycolmap().estimate_and_refine_absolute_pose(
            pixels, points, self._camera, estimation_options=options, return_covariance=True
        )
        if found is None or found["num_inliers"] < self.settings.min_inliers:
            return None
        covariance = _of_plane(np.asarray(found["covariance"]), found["cam_from_world"])
        return Located(
            pose_on_plane(found["cam_from_world"]), covariance, int(found["num_inliers"]), found["num_inliers"] / len(pixels)
        )

    def _bump(self, located: Located, headings: Float64 | None = None) -> Float32:
        away = np.hypot(*(self.places.positions - located.pose[:2]).T) / self.places.spacing
        turned = angle_difference(self._headings if headings is None else headings, located.pose[2]) / np.radians(_BUMP_DEG)
        return np.asarray(np.exp(-0.5 * (away[None, :] ** 2 + turned[:, None] ** 2)), dtype=np.float32)


class ColmapSiftModel(StructurePeer):
    """COLMAP with its own SIFT (model ``colmap_sift``)."""

    name = "colmap_sift"

    @staticmethod
    def features(settings: ColmapSiftSettings) -> Features:
        """SIFT."""
        return Sift(settings.features, settings.ratio)


class XFeatModel(StructurePeer):
    """The same with learned features, XFeat and LighterGlue (model ``xfeat``)."""

    name = "xfeat"

    @staticmethod
    def features(settings: XFeatSettings) -> Features:
        """XFeat."""
        return XFeat(settings.features, settings.least_cosine)


def _of_plane(covariance: Float64, cam_from_world: Any) -> Float64:
    """Covariance of x, y and heading from COLMAP's of a small turn in the camera and the translation."""
    rotation = np.asarray(cam_from_world.rotation.matrix())
    # The centre is -R^T t; a small turn w of the camera moves it by -R^T [t]x w, and its y axis points down: w_y turns clockwise.
    t = np.asarray(cam_from_world.translation)
    cross = np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
    jacobian = np.zeros((3, 6))
    jacobian[:2] = np.hstack([-rotation.T @ cross, -rotation.T])[:2]
    jacobian[2, 1] = -1.0
    plane = jacobian @ covariance @ jacobian.T
    return np.asarray(0.5 * (plane + plane.T) + np.diag([1e-8, 1e-8, 1e-10]))
