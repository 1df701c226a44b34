"""Images of drives compared with a map: the camera of the drives, and the poses of the images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.camera import AnyCamera, Panorama, Unwrapper
from panoloc_mcl.robot.errors import DatasetError, ImageError
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.map.camera_search.blocks import Equations, agreeing, derivative, residual, without_pose
from panoloc_mcl.robot.map.camera_search.features import (
    COARSE_COLUMNS,
    Features,
    Warp,
    features_of,
    flow_of,
    geometry_for_calibration,
    softened,
    unwrapped,
)
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel
from panoloc_mcl.robot.observation.votes import VotesModel
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import References, read_references
from panoloc_mcl.robot.settings.observation import ObservationSettings, VotesSettings
from panoloc_mcl.robot.single_blas import one_blas_thread
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer
from panoloc_mcl.tools.datasets import Sequence as Drive

Float64 = NDArray[np.float64]

_MOST_IMAGES, _SOURCES = 20, 2
_POSE_STEPS = np.array([0.01, 0.01, np.radians(0.4)])
_LEAST_AGREEMENT = 0.2


@dataclass(frozen=True, eq=False)
class Track:
    """Where the images of a drive were taken.

    Parameters
    ----------
    drive : Sequence
    times : float64 (n,)
        Of the images that were found in the map.
    poses : float64 (n, 3)
        Of the camera, with the base's heading.
    indices : int64 (n,)
        Of the images.
    """

    drive: Drive
    times: Float64
    poses: Float64
    indices: NDArray[np.int64]


class Yardstick:
    """The references as a map that images of drives are compared with.

    Parameters
    ----------
    references : References
    settings : VotesSettings
    progress : callable (done, total, what)
    panorama_map : PanoramaMap, optional
        Of these references, if there is one; its model is made otherwise, without what does not matter here.
    """

    def __init__(
        self,
        references: References,
        settings: VotesSettings,
        progress: Progress = no_progress,
        panorama_map: PanoramaMap | None = None,
    ) -> None:
        self.references = references
        if panorama_map is None:
            # How far poses are to be believed does not matter here.
            self.settings = settings.model_copy(update={"calibration_references": 0})
            self.panoramas = read_references(references, progress)
            with one_blas_thread():
                model = VotesModel.build(self.panoramas, self.settings, 0, progress)
            self.model: ObservationModel = model
            profiles, notes = model.arrays().get("profiles"), model.notes
        else:
            self.settings, self.panoramas = settings, panorama_map.references
            self.model = panorama_map.observation_model(ObservationSettings(votes=settings))
            profiles, notes = panorama_map.arrays.get("profiles"), panorama_map.notes
        if profiles is None or self.panoramas.camera_height_m is None:
            raise DatasetError(f"{references.path}: no views can be made from these references; {'; '.join(notes)}")
        height = self.panoramas.camera_height_m
        self.synthesizer = ViewSynthesizer(self.panoramas, profiles.astype(np.float64), height)

    def track(self, drive: Drive, camera: AnyCamera, most: int = 80, progress: Progress = no_progress) -> Track:
        """Find images of a drive in the map, each by itself."""
        unwrap = Unwrapper(camera, drive.image_size, self.panoramas.geometry)
        chosen = np.unique(np.linspace(0, len(drive) - 1, most).round().astype(np.int64))
        poses, indices = [], []
        for done, index in enumerate(chosen):
            try:
                with one_blas_thread():
                    field = self.model.observe(unwrap(read_image(drive.files[int(index)])))
            except ImageError:
                continue
            found = field.measurement
            if found is not None and found.agreement.cosine >= _LEAST_AGREEMENT:
                poses.append(found.pose)
                indices.append(int(index))
            progress(done + 1, len(chosen), f"images of {drive.name}")
        where = np.array(indices, dtype=np.int64)
        return Track(drive, drive.times[where], np.array(poses).reshape(-1, 3), where)


class DrivesScene:
    """Some images of drives, each with the views of it that the map gives.

    Parameters
    ----------
    yardstick : Yardstick
    tracks : sequence of Track
        All of one camera.
    most : int
        Images looked at, evenly over all.
    columns : int
        Of the panoramas, at most.
    """

    def __init__(
        self, yardstick: Yardstick, tracks: Sequence[Track], most: int = _MOST_IMAGES, columns: int = COARSE_COLUMNS
    ) -> None:
        self._yardstick, self._settings = yardstick, yardstick.settings
        references = yardstick.references
        self.geometry = geometry_for_calibration(references.camera, references.image_size, columns)
        assert yardstick.panoramas.camera_height_m is not None
        self._warp = Warp(self.geometry, yardstick.panoramas.camera_height_m)
        raw = [softened(read_image(file), references.camera, self.geometry) for file in references.files]
        self._sources = unwrapped(references.camera, references.image_size, self.geometry, raw)
        self._source_poses = np.column_stack([references.camera_positions, references.base_headings])
        self._tree = cKDTree(references.camera_positions)
        everything = [(track, at) for track in tracks for at in range(len(track.indices))]
        chosen = np.unique(np.linspace(0, len(everything) - 1, most).round().astype(int)).tolist()
        self.image_size = tracks[0].drive.image_size
        self._images, poses = [], []
        for track, at in (everything[index] for index in chosen):
            image = read_image(track.drive.files[int(track.indices[at])])
            self._images.append(softened(image, track.drive.camera, self.geometry))
            poses.append(track.poses[at])
        self.poses = np.array(poses).reshape(-1, 3)
        self._pending: list[tuple[Float64, Float64]] = []

    def __len__(self) -> int:
        return len(self._images)

    def panoramas(self, camera: AnyCamera) -> list[Panorama]:
        """The images as a camera would have them."""
        return unwrapped(camera, self.image_size, self.geometry, self._images)

    def views(self, pose: Float64, sigma_px: float) -> list[Features]:
        """What the nearest references show from a pose."""
        count = min(_SOURCES, len(self._source_poses))
        nearest = np.atleast_1d(self._tree.query(pose[:2], k=count)[1])
        return [self._view(int(source), pose, sigma_px) for source in nearest]

    def _view(self, source: int, pose: Float64, sigma_px: float) -> Features:
        north = self._yardstick.synthesizer.profile_at(source, pose[:2])
        columns = np.arange(self.geometry.width) * (360.0 / self.geometry.width)
        # Column 0 along the image's heading; columns of a profile run clockwise from heading 0.
        at = columns - np.degrees(pose[2])
        profile = np.interp(at, np.arange(len(north)) * (360.0 / len(north)), north, period=360.0)
        return features_of(
            self._warp.view(self._sources[source], profile, between(pose, self._source_poses[source])), self._settings, sigma_px
        )

    def equations(
        self, camera: AnyCamera, varied: list[tuple[AnyCamera, AnyCamera]], steps: Float64, sigma_px: float
    ) -> list[Equations]:
        """Of every image (see `adjustment.Scene`)."""
        flows = [
            flow_of(camera, sides, float(step), self.image_size, self.geometry)
            for sides, step in zip(varied, steps, strict=True)
        ]
        found, self._pending = [], []
        for panorama, pose in zip(self.panoramas(camera), self.poses, strict=True):
            mine, views = features_of(panorama, self._settings, sigma_px), self.views(pose, sigma_px)
            start = residual([mine] * len(views), views)
            jacobian = np.stack([derivative(start, views, flow, None, 1.0) for flow in flows])
            aside = []
            for axis, step in enumerate(_POSE_STEPS):
                moved = [self.views(compose(pose, sign * step * np.eye(3)[axis]), sigma_px) for sign in (1.0, -1.0)]
                aside.append(derivative(start, views, None, (moved[0], moved[1]), float(step)))
            some, gain, slope = without_pose(start, jacobian, np.stack(aside), agreeing(start))
            found.append(some)
            self._pending.append((gain, slope))
        return found

    def moved(self, step: Float64) -> None:
        """Take the poses along."""
        limit = np.array([0.1, 0.1, np.radians(3.0)])
        changes = [np.clip(gain - slope @ step, -limit, limit) for gain, slope in self._pending]
        self.poses = np.array([compose(pose, change) for pose, change in zip(self.poses, changes, strict=True)])
