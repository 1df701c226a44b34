"""References that see the same walls: what they tell about the camera that took them all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from panoloc_mcl.robot.camera import AnyCamera, Panorama
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.map.camera_search.blocks import Equations, agreeing, derivative, residual, without_walls
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
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.depth import best_of_columns

Float64 = NDArray[np.float64]

_MOST_IMAGES, _NEIGHBOURS = 14, 3
_WALLS_M = np.geomspace(0.4, 15.0, 13)
# Smoothing with which two cameras are compared, as at the end of a search.
_FINE_PX = 1.0
_SMOOTHING_DEG = 9.0
_LOG_STEP = 0.03
# How far off positions are that say nothing of it.
_SURVEY_SD_M = 0.01
_COARSE_PX = 2.0


class ReferencesScene:
    """Some references, each with its nearest neighbours and the walls around it.

    Parameters
    ----------
    references : References
    settings : VotesSettings
        Of the features.
    camera : AnyCamera
        Where the search begins.
    most : int
        References looked at, evenly over all.
    columns : int
        Of the panoramas, at most.

    Raises
    ------
    DatasetError
        No two references at different places, or a camera whose height nobody says.
    """

    def __init__(
        self,
        references: References,
        settings: VotesSettings,
        camera: AnyCamera,
        most: int = _MOST_IMAGES,
        columns: int = COARSE_COLUMNS,
    ) -> None:
        if camera.height_m is None:
            raise DatasetError(f"{references.path}: camera.height_m is not given; say how high the camera is above the floor")
        positions = references.poses[:, :2]
        if len(np.unique(positions.round(3), axis=0)) < 3:
            raise DatasetError(f"{references.path}: has fewer than three places; the camera cannot be told from so few")
        self._references, self._settings = references, settings
        self.geometry = geometry_for_calibration(camera, references.image_size, columns)
        chosen = np.unique(np.linspace(0, len(positions) - 1, most).round().astype(int))
        self.targets = [int(index) for index in chosen]
        nearest = cKDTree(positions).query(positions[chosen], k=min(4 * _NEIGHBOURS, len(positions)))
        distances, found = (np.asarray(part) for part in nearest)
        self.neighbours = [
            [int(n) for d, n in zip(row_d, row_n, strict=True) if d > 1e-3][:_NEIGHBOURS]
            for row_d, row_n in zip(distances, found, strict=True)
        ]
        needed = sorted({*self.targets, *(n for some in self.neighbours for n in some)})
        self._place = {index: at for at, index in enumerate(needed)}
        self._images = [softened(read_image(references.files[index]), camera, self.geometry) for index in needed]
        # Of the walls; none yet.
        self.profiles: list[Float64] = []
        self._swept_at = np.inf
        self._pending: list[tuple[Float64, Float64]] = []

    def panoramas(self, camera: AnyCamera) -> list[Panorama]:
        """All images in use as a camera would have them: upright, column 0 where it looks itself.

        So its yaw turns no image, only the way from one to the other.
        """
        return unwrapped(_without_yaw(camera), self._references.image_size, self.geometry, self._images)

    def camera_poses(self, camera: AnyCamera) -> Float64:
        """Where the camera stood and looked, float64 (n, 3), of all references."""
        if self._references.poses_of == "camera":
            return self._references.poses
        mount = camera.mounting
        return compose(self._references.poses, np.array([mount.x_m, mount.y_m, mount.yaw]))

    def place_sd_m(self) -> float:
        """What errors of the survey make of the camera's place on the base, metres.

        That place moves the way from one reference to another only by as much as the base turned between them: references that all
        look the same way do not tell it, and small turns tell the errors of their positions instead.
        """
        poses, sds = self._references.poses, self._references.sds
        pairs = np.array([(target, one) for target, some in zip(self.targets, self.neighbours, strict=True) for one in some])
        swung = 2.0 * np.sin(0.5 * (poses[pairs[:, 1], 2] - poses[pairs[:, 0], 2]))
        given = np.full(len(poses), np.nan) if sds is None else sds[:, 0]
        of_ends = np.where(np.isfinite(given), given, _SURVEY_SD_M)[pairs]
        information = float(np.sum(swung**2 / np.maximum((of_ends**2).sum(axis=1), 1e-12)))
        return information**-0.5 if information > 0.0 else np.inf

    def views(
        self, camera: AnyCamera, panoramas: Sequence[Panorama], at: int, profile: Float64, sigma_px: float
    ) -> list[Features]:
        """The neighbours as seen from a target."""
        assert camera.height_m is not None
        warp, poses = Warp(self.geometry, camera.height_m), self.camera_poses(camera)
        target = self.targets[at]
        return [
            features_of(
                warp.view(panoramas[self._place[n]], profile, between(poses[target], poses[n])), self._settings, sigma_px
            )
            for n in self.neighbours[at]
        ]

    def pair(self, camera: AnyCamera, panoramas: Sequence[Panorama], at: int) -> tuple[Panorama, Panorama, Float64]:
        """A target, its nearest neighbour, and the pose of that as seen from the target."""
        poses, target, neighbour = self.camera_poses(camera), self.targets[at], self.neighbours[at][0]
        apart = between(poses[target], poses[neighbour])
        return panoramas[self._place[target]], panoramas[self._place[neighbour]], apart

    def own(self, panoramas: Sequence[Panorama], at: int, sigma_px: float) -> Features:
        """A target itself."""
        return features_of(panoramas[self._place[self.targets[at]]], self._settings, sigma_px)

    def sweep(self, camera: AnyCamera, sigma_px: float, targets: Sequence[int] | None = None) -> float:
        """Find the walls around targets by trying distances; gives the agreement that they reach."""
        panoramas = self.panoramas(camera)
        # Odd: an even number of columns has no middle, and walls half a column aside look like a camera that is turned.
        width = 2 * round(0.5 * (_SMOOTHING_DEG * self.geometry.width / 360.0 - 1.0)) + 1
        tried = np.repeat(np.log(_WALLS_M)[:, None], self.geometry.width, axis=1)
        profiles, common, energy = [], 0.0, 0.0
        for at in range(len(self.targets)) if targets is None else targets:
            mine = self.own(panoramas, at, sigma_px)
            found = []
            for wall in _WALLS_M:
                views = self.views(camera, panoramas, at, np.full(self.geometry.width, wall), sigma_px)
                found.append(residual([mine] * len(views), views))
            commons, energies = (
                uniform_filter1d(np.stack(part), width, axis=1, mode="wrap")
                for part in ([one.common for one in found], [one.energy for one in found])
            )
            score = commons / np.maximum(energies, 1e-3 + 0.05 * energies.max())
            best = np.argmax(score, axis=0)
            columns = np.arange(len(best))
            profiles.append(np.exp(best_of_columns(score, tried)))
            common += float(commons[best, columns].sum())
            energy += float(energies[best, columns].sum())
        if targets is None:
            self.profiles = profiles
        return common / max(energy, 1e-12)

    def gain(self, camera: AnyCamera, other: AnyCamera) -> tuple[float, float]:
        """By how much targets agree better with one camera than with another, each with walls of its own; and its standard error."""
        targets = range(len(self.targets))
        more = np.array([self.sweep(camera, _FINE_PX, [at]) - self.sweep(other, _FINE_PX, [at]) for at in targets])
        return float(more.mean()), float(more.std(ddof=1) / np.sqrt(len(more)))

    def equations(
        self, camera: AnyCamera, varied: list[tuple[AnyCamera, AnyCamera]], steps: Float64, sigma_px: float
    ) -> list[Equations]:
        """Of every target (see `adjustment.Scene`)."""
        # While the camera is far off, walls found with it are, too.
        if sigma_px >= _COARSE_PX or sigma_px < self._swept_at:
            self.sweep(camera, sigma_px)
            self._swept_at = sigma_px
        panoramas = self.panoramas(camera)
        others = [(self.panoramas(one), self.panoramas(other)) for one, other in varied]
        size = self._references.image_size
        flows = [
            flow_of(_without_yaw(camera), (_without_yaw(up), _without_yaw(down)), float(step), size, self.geometry)
            for (up, down), step in zip(varied, steps, strict=True)
        ]
        found, self._pending = [], []
        for at, profile in enumerate(self.profiles):
            views = self.views(camera, panoramas, at, profile, sigma_px)
            start = residual([self.own(panoramas, at, sigma_px)] * len(views), views)
            jacobian = []
            for sides, seen, flow, step in zip(varied, others, flows, steps, strict=True):
                moved = [self.views(one, some, at, profile, sigma_px) for one, some in zip(sides, seen, strict=True)]
                jacobian.append(derivative(start, views, flow, (moved[0], moved[1]), float(step)))
            walls = [self.views(camera, panoramas, at, profile * np.exp(sign * _LOG_STEP), sigma_px) for sign in (1, -1)]
            wall = derivative(start, views, None, (walls[0], walls[1]), _LOG_STEP)
            some, gain, slope = without_walls(start, np.stack(jacobian), wall, agreeing(start))
            found.append(some)
            self._pending.append((gain, slope))
        return found

    def moved(self, step: Float64) -> None:
        """Take the walls along."""
        for at, (gain, slope) in enumerate(self._pending):
            change = np.clip(gain - step @ slope, -0.25, 0.25)
            self.profiles[at] = np.clip(self.profiles[at] * np.exp(change), 0.2, 30.0)


def _without_yaw(camera: AnyCamera) -> AnyCamera:
    return camera.model_copy(update={"mount": camera.mounting.model_copy(update={"yaw_deg": 0.0})})
