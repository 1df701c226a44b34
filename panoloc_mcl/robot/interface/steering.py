"""What a robot's program asks of a localizer and tells it, besides images and odometry."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.errors import MeasurementError
from panoloc_mcl.robot.filters import Cluster, Start, Status
from panoloc_mcl.robot.geometry import compose, inverse
from panoloc_mcl.robot.interface.answers import Location, TimedPose, located
from panoloc_mcl.robot.interface.contradictions import Contradictions
from panoloc_mcl.robot.interface.mounting_tilt import MountingTilt
from panoloc_mcl.robot.interface.parts import Parts
from panoloc_mcl.robot.interface.starting import make_filter, start_around
from panoloc_mcl.robot.locks import locked
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.motion import Anchor, Motion, carried_to, seconds
from panoloc_mcl.robot.observation import VoteField
from panoloc_mcl.robot.reasons import Finding, Reason
from panoloc_mcl.robot.single_blas import one_blas_thread

Float64 = NDArray[np.float64]

_CONTRADICTED = Finding(
    "floor and walls of many images contradict each other about the pose, more than in those of the map, so less is claimed; "
    + Reason.CAMERA_CONTRADICTED.remedy,
    Reason.CAMERA_CONTRADICTED,
)


class Steering(Parts):
    """Poses at any time, poses that somebody gives, other maps."""

    def pose_at(self, timestamp: float | None = None) -> TimedPose | None:
        """The pose at a time between or after images, at the rate of odometry.

        Parameters
        ----------
        timestamp : float, optional
            Seconds; that of the newest odometry if left out.

        Returns
        -------
        TimedPose or None
            None before the first answer.

        Raises
        ------
        MeasurementError
            The time stamp tells no time, or is not finite.
        """
        if timestamp is not None and not math.isfinite(timestamp := seconds(timestamp)):
            raise MeasurementError(f"pose_at: time stamp {timestamp} is not finite; give seconds, or leave it out")
        if self._anchor is None:
            return None
        anchor, status = self._anchor
        if self._clock.owed_s:
            anchor = replace(anchor, timestamp=anchor.timestamp - self._clock.owed_s)
        timestamp = max(self._odometry.newest, anchor.timestamp) if timestamp is None else timestamp
        pose, covariance = carried_to(anchor, self._odometry, timestamp)
        if self._mount.offset.any():
            of_base = Cluster(pose, covariance, 1.0).of_point(-self._mount.offset)
            pose, covariance = of_base.pose, of_base.covariance
        if status is Status.CONVERGED and not self._is_narrow(covariance):
            status = Status.STALE
        return TimedPose(timestamp, pose, covariance, status, anchor.timestamp)

    def _is_narrow(self, covariance: Float64) -> bool:
        """Whether a pose is known well enough to be called so: odometry alone may have led too far since the last answer."""
        (xx, xy, _), (_, yy, _), (_, _, tt) = covariance.tolist()
        largest = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
        limits = self.settings.status
        return bool(largest < limits.converged_spread_m**2 and tt < math.radians(limits.converged_spread_deg) ** 2)

    def odometry_to_map(self, timestamp: float | None = None) -> TimedPose | None:
        """Pose of odometry's frame in the map (``map`` to ``odom`` in ROS), as `pose_at`; None without odometry, too."""
        robot = self.pose_at(timestamp)
        driven = None if robot is None else self._odometry.raw_pose_at(robot.timestamp)
        if robot is None or driven is None:
            return None
        driven = self._mount.base_poses(driven)
        return TimedPose(robot.timestamp, compose(robot.pose, inverse(driven)), robot.covariance, robot.status, robot.answered)

    def driven(self, timestamp: float) -> Float64 | None:
        """Pose (3,) of the base in odometry's frame at a time; None without odometry."""
        pose = self._odometry.raw_pose_at(timestamp)
        return None if pose is None else self._mount.base_poses(pose)

    @locked
    def locate(self, image: NDArray[Any]) -> Location:
        """Where the robot was when one image was taken, by that image alone; the belief is neither asked nor changed.

        Raises
        ------
        ImageError
            Another size or type than the camera delivers.
        """
        with one_blas_thread():
            votes = self._observation.observe(self._unwrap(image), None)
        return located(votes, self.map_revision, self._mount, self._map.name)

    @locked
    def set_pose(self, pose: ArrayLike, covariance: ArrayLike | None = None, timestamp: float | None = None) -> None:
        """Believe a pose that somebody gives (``initialpose`` in ROS), whatever was believed before.

        Parameters
        ----------
        pose : array_like of float, shape (3,)
            x, y, heading in the map frame, metres and radians.
        covariance : array_like of float, shape (3, 3), optional
            That of the default start pose if left out.
        timestamp : float, optional
            When the robot was there, seconds; at the newest odometry or image if left out.

        Raises
        ------
        MeasurementError
            Not finite, of another shape, or a covariance that none can have.
        """
        start = start_around(pose, covariance, self._mount)
        self._follow_odometry()
        newest = max(self._odometry.newest, -math.inf if self._clock.now is None else self._clock.now)
        when = newest if timestamp is None else seconds(timestamp)
        self._begin_anew(start, when if math.isfinite(when) else None)
        state = self._filter.state()
        self._has_fix = state.status is Status.CONVERGED
        if math.isfinite(when):
            self._anchor = Anchor(when, state.clusters[0].pose, state.clusters[0].covariance), state.status

    @locked
    def relocalize(self) -> None:
        """Forget the pose: the robot may be anywhere."""
        self._follow_odometry()
        self._begin_anew(Start(), self._clock.now)

    @locked
    def load_map(self, panorama_map: PanoramaMap, keep_pose: bool = False) -> None:
        """Go on in another map. Until all of it is known to fit, this localizer goes on in the old one.

        Parameters
        ----------
        panorama_map : PanoramaMap
        keep_pose : bool
            Both maps have the same frame, so the pose holds; otherwise it is forgotten.

        Raises
        ------
        MapError, CameraError
            The map does not fit the camera or the settings. This localizer is then as before.
        """
        unwrap = panorama_map.unwrapper(self._camera, self._image_size)
        observation = panorama_map.observation_model(self.config.observation)
        self._follow_odometry()
        known = self._anchor if keep_pose else None
        # A pose that was given before the first odometry has no time yet.
        given = self._filter.state().clusters[0] if keep_pose and known is None and self._has_fix else None
        self._map, self._unwrap, self._observation, self._revision = panorama_map, unwrap, observation, ""
        self._mount, self._stamp_offset_s = unwrap.camera.mounting, unwrap.camera.stamp_offset_s
        # Its references may lean otherwise, and its camera may be described otherwise.
        self._mounting_tilt, self._contradictions = MountingTilt(), Contradictions()
        pose = given if known is None else known[0]
        self._begin_anew(Start() if pose is None else Start.around(pose.pose, pose.covariance), self._clock.now)
        if known is not None:
            self._anchor, self._has_fix = known, known[1] is Status.CONVERGED
        self._has_fix |= given is not None

    def _begin_anew(self, start: Start, timestamp: float | None) -> None:
        self._begun_anew += 1
        entropy = (self._seed,) if isinstance(self._seed, int) else tuple(self._seed)
        rng = np.random.default_rng((*entropy, self._begun_anew))
        self._filter = make_filter(self.settings, self._observation.places, start, rng)
        self._clock.start_at(timestamp)
        self._sightings = self._new_sightings(start)
        self._anchor, self._has_fix, self._forced = None, False, True

    def _follow_odometry(self) -> None:
        """Keep pose and belief, by the new time, where odometry's clock was set back."""
        back = self._clock.follow_odometry()
        if back and self._anchor is not None:
            anchor, status = self._anchor
            self._anchor = replace(anchor, timestamp=anchor.timestamp - back), status

    def force_update(self) -> None:
        """Let the next image count, whatever the motion gate says: for a robot that stands and is to look again."""
        self._forced = True

    @property
    def has_fix(self) -> bool:
        """Whether the pose has been known since the start, the last `relocalize` or `load_map`; it may be lost since."""
        return self._has_fix

    @property
    def mounting_tilt(self) -> MountingTilt:
        """How the camera leans on its mount against the references, as far as images told that it stays."""
        return self._mounting_tilt

    @property
    def contradictions(self) -> Contradictions:
        """How far floor and walls contradict each other about the poses of images so far: is the camera as it is described?"""
        return self._contradictions

    def _learn_of_camera(self, votes: VoteField, motion: Motion) -> tuple[VoteField, Finding]:
        """How the camera leans and whether it is as it is described, from an image that is sure of itself.

        Returns
        -------
        votes : VoteField
            With no more claimed for the measured pose than images of this drive deserve.
        found : Finding
            Said once, when enough images say it.
        """
        before = self._contradictions
        self._mounting_tilt, self._contradictions = self._mounting_tilt.moved(motion.distance), before.moved(motion.distance)
        measured = votes.measurement
        if not votes.informative or measured is None:
            return votes, Finding()
        if votes.confidence >= self.settings.status.converged_confidence:
            self._mounting_tilt = self._mounting_tilt.seen(measured.tilt)
            self._contradictions = self._contradictions.seen(measured.excess)
        widened = measured.widened(self._contradictions.usual)
        votes = votes if widened is measured else votes.with_measurement(widened)
        return votes, _CONTRADICTED if self._contradictions.tell and not before.tell else Finding()

    @property
    def map_revision(self) -> str:
        """Names the content of the map: equal maps have equal ones."""
        if not self._revision:
            references = self._map.references
            digest = hashlib.sha256(json.dumps([self._map.name, self._map.seed]).encode())
            for array in (references.pixels, references.positions, self._observation.places.positions):
                digest.update(np.ascontiguousarray(array).tobytes())
            self._revision = digest.hexdigest()
        return self._revision

    @property
    def counts(self) -> dict[str, int]:
        """How many messages came, and what became of them."""
        left_out = {f"odometry: {reason}": count for reason, count in dict(self._odometry.rejected).items()}
        return {
            "images": self._images,
            "images skipped": self.images_skipped,
            "images without motion": self._gated,
            "odometry": self._odometry.taken,
            **left_out,
            **{f"odometry: {event}": count for event, count in dict(self._odometry.events).items()},
        }
