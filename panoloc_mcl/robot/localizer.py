"""The localizer: images and odometry in, poses out. This page is the algorithm."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.camera import Camera, Unwrapper
from panoloc_mcl.robot.errors import FrozenCameraError, ImageError
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.interface.answers import tells_more
from panoloc_mcl.robot.interface.contradictions import Contradictions
from panoloc_mcl.robot.interface.frozen_camera import FrozenCamera
from panoloc_mcl.robot.interface.mounting_tilt import MountingTilt
from panoloc_mcl.robot.interface.saved_state import SavedState
from panoloc_mcl.robot.interface.starting import make_filter, start_of
from panoloc_mcl.robot.interface.taking import TakesMessages
from panoloc_mcl.robot.locks import Lock, locked
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.motion import Anchor, ImageClock, Motion, OdometryBuffer, blind, planar_pose, seconds
from panoloc_mcl.robot.motion.pace import Pace, paced
from panoloc_mcl.robot.observation import ObservationModel, Places, VoteField
from panoloc_mcl.robot.observation.field import silent_field
from panoloc_mcl.robot.observation.peaks import Guess
from panoloc_mcl.robot.observation.tracking import Expected, TrackingModel
from panoloc_mcl.robot.progress import timed
from panoloc_mcl.robot.reasons import Finding, Reason
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.single_blas import one_blas_thread

# While the pose is known, so many-th images are searched for all over the map all the same.
_SEARCHED_EVERY = 10
# Until the pose is known, an image may know more of it than the belief.
_UNDECIDED = (Status.SEARCHING, Status.AMBIGUOUS)


class Localizer(SavedState, TakesMessages):
    """Tells a robot with a panoramic camera where it is and where it looks.

    All methods may be called from any thread: images are processed one at a time, and neither `add_odometry` nor `pose_at` waits
    for one. Only ``particles`` belongs to the thread that adds images. The same calls in the same order give the same bits.

    Parameters
    ----------
    panorama_map : PanoramaMap
    config : LocalizerConfig
        ``observation``, ``localizer`` and ``seed`` are used.
    camera : PanoramaCamera or OmniCamera, optional
        That the images come from; the map's own camera if left out.
    image_size : (int, int), optional
        Width and height of its images, pixels; as the map's references if left out.
    start_pose : (x, y, heading), optional
        For ``initial: known_heading`` and ``known_pose``: metres and radians.
    seed : int or sequence of int, optional
        Instead of ``config.seed``.
    model : ObservationModel, optional
        The map's observation model, when several localizers share one.

    Raises
    ------
    ConfigError, MeasurementError
        ``initial`` asks for a start pose and there is none, or one that cannot be.
    MapError, CameraError
        The map does not fit the camera.
    """

    def __init__(
        self,
        panorama_map: PanoramaMap,
        config: LocalizerConfig | None = None,
        *,
        camera: Camera | None = None,
        image_size: tuple[int, int] | None = None,
        start_pose: tuple[float, float, float] | None = None,
        seed: int | tuple[int, ...] | None = None,
        model: ObservationModel | None = None,
    ) -> None:
        config = config or LocalizerConfig().model_copy(update={"observation": panorama_map.observation})
        self.config = config
        self.settings = config.localizer
        self._map = panorama_map
        self._unwrap = panorama_map.unwrapper(camera, image_size)
        # Images tell the camera's pose, so that is what the filter holds; the poses that come in and go out are the base's.
        self._mount, self._stamp_offset_s = self._unwrap.camera.mounting, self._unwrap.camera.stamp_offset_s
        self._observation = model or panorama_map.observation_model(config.observation)
        self._revision = ""
        self._camera, self._image_size = camera, image_size
        self._odometry = OdometryBuffer(self.settings.motion)
        self._seed = config.seed if seed is None else seed
        rng = np.random.default_rng(self._seed)
        start = start_of(self.settings, start_pose, self._mount)
        self._filter = make_filter(self.settings, self._observation.places, start, rng)
        self._clock = ImageClock(self.settings.motion, self._odometry)
        self._sightings = self._new_sightings(start)
        self._pace: Pace | None = None
        self._frozen_camera = FrozenCamera()
        self._mounting_tilt, self._contradictions = MountingTilt(), Contradictions()
        self._reported: dict[str, int] = {}
        # The next image counts whatever the motion gate says.
        self._forced = False
        self._gated = self._images = self._begun_anew = 0
        self.images_skipped = 0
        # The last answer: where the pose between images begins.
        self._anchor: tuple[Anchor, Status] | None = None
        self._has_fix = False
        self._lock = Lock()

    def add_odometry(
        self, timestamp: float, pose: ArrayLike, velocity: ArrayLike | None = None, covariance: ArrayLike | None = None
    ) -> bool:
        """Take one odometry measurement; it may come late or out of order.

        Parameters
        ----------
        timestamp : float
            Seconds; or a datetime, or a ROS stamp.
        pose : array_like of float, shape (3,)
            x, y, heading of the base in the odometry frame, metres and radians. One that is not finite is left out and counted.
        velocity, covariance : array_like of float, shape (3,) and (3, 3), optional
            As in `Odometry`.

        Returns
        -------
        bool
            Whether it was taken; `counts` says why others were not.

        Raises
        ------
        MeasurementError
            The stamp tells no time, or the pose or the velocity has not three numbers.
        """
        of_camera = self._mount.camera_poses(planar_pose(pose, "odometry pose"))
        speed = None if velocity is None else self._mount.camera_velocity(planar_pose(velocity, "odometry velocity"))
        spread = None if covariance is None else np.asarray(covariance, dtype=np.float64)
        return self._odometry.add(seconds(timestamp), of_camera, speed, spread)

    @locked
    def add_image(self, timestamp: float, image: NDArray[Any] | ImageError) -> Estimate | None:
        """Take one image as the camera delivers it.

        Parameters
        ----------
        timestamp : float
            Seconds, or a datetime, or a ROS stamp, by the clock of the images: ``camera.time_offset_s`` is added. May
            be earlier than that of the image before, within the odometry that is kept.
        image : ndarray of uint8 or uint16, shape (rows, columns) or (rows, columns, 3 or 4)
            Grey, or colour in OpenCV's order. Instead, the `ImageError` that reading it gave: it is then a bad image like any other.

        Returns
        -------
        Estimate or None
            None while the motion gate is shut. An image that cannot be used is skipped and counted; the estimate then rests on
            odometry alone and says why. After a late image the estimate is that of the newest image's time, bettered by the late one.

        Raises
        ------
        MeasurementError
            The stamp tells no time.
        """
        stage_ms: dict[str, float] = {}
        self._images += 1
        timestamp = seconds(timestamp) + self._stamp_offset_s
        self._follow_odometry()
        set_back = self._clock.set_back(timestamp + self._clock.offset_s)
        timestamp += self._clock.offset_s
        problem = self._clock.problem(timestamp)
        if problem:
            self.images_skipped += 1
            self._sightings.left_out(problem.reason)
            return self._estimate([set_back, problem], None, stage_ms)
        note = self._follow_clock(timestamp)
        motion, offset = self._motion_to(timestamp)
        # An image that tells of a clock counts, or nobody would hear of it.
        if not (set_back or note or self._gate_opens(motion if offset is None else offset)):
            self._gated += 1
            return None
        with one_blas_thread():
            with timed(stage_ms, "predict"):
                self._filter.propagate(motion)
                headings = self._filter.heading_hypotheses(offset)
            with timed(stage_ms, "observe"):
                expected = None if headings is not None or offset is not None else self._expected()
                votes, found = self._observe(timestamp, image, headings, expected)
                votes, contradicted = self._learn_of_camera(votes, motion)
            with timed(stage_ms, "update"):
                self._filter.update(votes, offset)
                self._look_back(votes, found, motion.distance)
            self._clock.fuse(timestamp)
            self._forced = False
            hurry = self._hurry(timestamp, votes, motion if offset is None else None)
            return self._estimate([set_back, note, found, contradicted, hurry], votes, stage_ms, late=offset is not None)

    @property
    def particles(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Poses (n, 3) and weights (n,) of the belief, n = 0 in a mode without particles.

        Only to be looked at, and by the thread that adds images: they change in place.
        """
        poses, weights = self._filter.particles()
        return self._mount.base_poses(poses), weights

    @property
    def panorama_map(self) -> PanoramaMap:
        """The map that poses are in."""
        return self._map

    @property
    def unwrapper(self) -> Unwrapper:
        """That makes panoramas of the camera's images."""
        return self._unwrap

    @property
    def places(self) -> Places:
        """The places that images vote for."""
        return self._observation.places

    def _follow_clock(self, timestamp: float) -> Finding:
        """If two images agree that the clock has jumped, go on by the new time; what happened meanwhile is unknown."""
        jump = self._clock.follow(timestamp)
        if jump is None:
            return Finding()
        # The robot was moving for some time that the clock does not tell.
        unknown = self.settings.motion.clock_jump_s
        self._filter.propagate(blind(Motion(np.zeros(3), duration_s=unknown), unknown, self.settings.motion))
        return Finding(f"image stamps jumped by {jump:+.3f} s; going on from there", Reason.CLOCK_JUMPED)

    def _motion_to(self, timestamp: float) -> tuple[Motion, Motion | None]:
        """Motion of the belief up to an image; for a late one none, but the way back from the belief's time to the image's."""
        now = timestamp if self._clock.now is None else self._clock.now
        if self._clock.is_late(timestamp):
            return self._odometry.motion(now, now), self._odometry.motion(now, timestamp)
        return self._odometry.motion(now, timestamp), None

    def _gate_opens(self, motion: Motion) -> bool:
        gate = self.settings.gate
        if self._forced or self._clock.now is None or gate.distance_m == gate.angle_deg == 0.0 or motion.blind_s > 0.0:
            return True
        moved = gate.distance_m > 0.0 and motion.distance >= gate.distance_m
        turned = gate.angle_deg > 0.0 and motion.turn >= math.radians(gate.angle_deg)
        return moved or turned

    def _expected(self) -> Expected | None:
        """Where the image was taken, as the belief predicts it; None if the belief has not converged, or tracking is off."""
        belief = self._filter.state()
        if not self.settings.tracking or belief.status is not Status.CONVERGED:
            return None
        taken_in = self._images - self.images_skipped - self._gated
        best = belief.clusters[0]
        return Expected.of(best.pose, best.spread_m, best.spread_deg, taken_in % _SEARCHED_EVERY == 0)

    def _observe(
        self,
        timestamp: float,
        image: NDArray[Any] | ImageError,
        headings: NDArray[np.float64] | None,
        expected: Expected | None,
    ) -> tuple[VoteField, Finding]:
        """Vote field of an image, and what is wrong with it; one that cannot be used gives a field that is silent."""
        try:
            if isinstance(image, ImageError):
                raise image
            panorama = self._unwrap(image)
            self._frozen_camera.check(image, self.driven(timestamp))
            if expected is not None and isinstance(self._observation, TrackingModel):
                votes = self._observation.observe_near(panorama, expected)
            else:
                votes = self._observation.observe(panorama, headings)
            # Only an image that was compared with the map has a confidence.
            reason = Reason.IMAGE_BLANK if math.isnan(votes.confidence) else Reason.FITS_NOWHERE
        except ImageError as error:
            asked = np.zeros(1) if headings is None else headings
            votes = silent_field(asked, self._observation.places, str(error), full_circle=headings is None)
            reason = Reason.IMAGE_FROZEN if isinstance(error, FrozenCameraError) else Reason.IMAGE_UNUSABLE
        return votes, Finding() if votes.informative else Finding(votes.problem, reason)

    def _hurry(self, timestamp: float, votes: VoteField, motion: Motion | None) -> Finding:
        """Whether sure images say, where no odometry is known, that the robot drives faster than is believed."""
        measured = votes.measurement
        if motion is None or measured is None or not votes.confidence >= self.settings.status.converged_confidence:
            return Finding()
        spread = math.sqrt(float(np.linalg.eigvalsh(measured.covariance[:2, :2])[-1]))
        before = self._pace if motion.blind_s > 0.5 * motion.duration_s else None
        limit = self.settings.motion.image_only_speed_m_s
        self._pace, told = paced(before, timestamp, measured.pose[:2].tolist(), spread, limit)
        return told

    def _estimate(
        self, findings: list[Finding], votes: VoteField | None, stage_ms: dict[str, float], late: bool = False
    ) -> Estimate:
        with timed(stage_ms, "estimate"):
            of_camera = self._filter.state()
            # Arrays of its own: whoever gets the answer may change them.
            state = of_camera.of_point(-self._mount.offset)
        best, now = state.clusters[0], self._clock.now
        # A belief that an image was left out of may stand at an old time.
        outdated = votes is None and now is not None and self._odometry.newest > now
        since = self._odometry.motion(now, self._odometry.newest) if now is not None and outdated else None
        status, doubt = self._sightings.judge(state.status, since)
        self._has_fix |= status is Status.CONVERGED
        if now is not None:
            self._anchor = Anchor(now, of_camera.clusters[0].pose, of_camera.clusters[0].covariance), status
        found = [finding for finding in (*findings, *self._news_of_odometry(), doubt) if finding]
        reasons = dict.fromkeys(finding.reason for finding in found if finding.reason is not None)
        guess = None if votes is None else self._guess(votes)
        pose = best.pose
        if guess is not None and not late and status in _UNDECIDED and tells_more(guess, best, first=self._images == 1):
            pose = guess.pose.copy()
        return Estimate(
            timestamp=math.nan if now is None else now,
            pose=pose,
            covariance=best.covariance,
            status=status,
            message="; ".join(found),
            state=state,
            vote_field=votes,
            stage_ms=stage_ms,
            reasons=tuple(reasons),
            best_guess=guess,
            map=self._map.name,
        )

    def _guess(self, votes: VoteField) -> Guess | None:
        """What the image says by itself, about the base."""
        guess = votes.guess
        return None if guess is None else replace(guess, pose=self._mount.base_poses(guess.pose))

    def _news_of_odometry(self) -> Iterator[Finding]:
        """What odometry was left out since the last answer, and what else befell it."""
        before, self._reported = self._reported, dict(self._odometry.rejected) | dict(self._odometry.events)
        for reason in dict(self._odometry.rejected):
            new = self._reported.get(reason, 0) - before.get(reason, 0)
            if new:
                yield Finding(
                    f"{new} odometry measurement{'s' if new > 1 else ''} left out ({reason})", Reason.ODOMETRY_LEFT_OUT
                )
        for event in dict(self._odometry.events):
            if self._reported.get(event, 0) > before.get(event, 0):
                back, looped = "set back" in event, "again" in event
                kind = Reason.CLOCK_SET_BACK if back else Reason.STREAM_LOOPED if looped else Reason.CLOCK_JUMPED
                yield Finding(f"odometry: {event}", None if "origin" in event else kind)
