"""The localizer: images and odometry in, poses out. This page is the algorithm."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.camera import Camera, Mount
from panoloc_mcl.robot.errors import ConfigError, ImageError, StateError
from panoloc_mcl.robot.files import read_arrays, write_arrays
from panoloc_mcl.robot.filters import (
    Estimate,
    KalmanOrientationFilter,
    MonteCarloFilter,
    OdometryOnlyFilter,
    PoseFilter,
    Sightings,
    Start,
)
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.motion import ImageClock, Motion, OdometryBuffer, blind, is_possible, planar_pose, seconds
from panoloc_mcl.robot.observation import ObservationModel, Places, VoteField
from panoloc_mcl.robot.observation.field import silent_field
from panoloc_mcl.robot.reasons import Finding, Reason
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.settings.localizer import InitialPose, LocalizerSettings
from panoloc_mcl.robot.single_blas import one_blas_thread

STATE_FORMAT = "panoloc-state/4"


class Localizer:
    """Tells a robot with a panoramic camera where it is and where it looks.

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
        config = config or LocalizerConfig()
        self.config = config
        self.settings = config.localizer
        self._map = panorama_map
        self._unwrap = panorama_map.unwrapper(camera, image_size)
        # Images tell the camera's pose, so that is what the filter holds; the poses that come in and go out are the base's.
        self._mount, self._stamp_offset_s = self._unwrap.camera.mounting, self._unwrap.camera.stamp_offset_s
        self._observation = model or panorama_map.observation_model(config.observation)
        self._odometry = OdometryBuffer(self.settings.motion)
        rng = np.random.default_rng(config.seed if seed is None else seed)
        self._filter = self._make_filter(self._observation.places, _start(self.settings, start_pose, self._mount), rng)
        self._clock = ImageClock(self.settings.motion, self._odometry)
        self._sightings = Sightings(self.settings.status)
        self._reported: dict[str, int] = {}
        # The next image counts whatever the motion gate says.
        self._forced = False
        self.images_skipped = 0

    def _make_filter(self, places: Places, start: Start, rng: np.random.Generator) -> PoseFilter:
        if self.settings.mode == "monte_carlo":
            return MonteCarloFilter(places, start, self.settings.monte_carlo, self.settings.status, rng)
        if self.settings.mode == "odometry_only":
            return OdometryOnlyFilter(places, start, self.settings.status)
        return KalmanOrientationFilter(places, start, self.settings.kalman_orientation, self.settings.status, rng)

    def add_odometry(self, timestamp: float, pose: ArrayLike) -> None:
        """Take one odometry measurement; it may come late or out of order.

        Parameters
        ----------
        timestamp : float
            Seconds; or a datetime, or a ROS stamp.
        pose : array_like of float, shape (3,)
            x, y, heading of the base in the odometry frame, metres and radians. One that is not finite is left out and counted.

        Raises
        ------
        MeasurementError
            The stamp tells no time, or the pose has not three numbers.
        """
        self._odometry.add(seconds(timestamp), self._mount.camera_poses(planar_pose(pose, "odometry pose")))

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
        timestamp = seconds(timestamp) + self._stamp_offset_s
        problem = self._clock.problem(timestamp)
        if problem:
            self.images_skipped += 1
            self._sightings.left_out(problem.reason)
            return self._estimate([problem], None, stage_ms)
        note = self._follow_clock(timestamp)
        motion, offset = self._motion_to(timestamp)
        if not self._gate_opens(motion if offset is None else offset):
            return None
        with one_blas_thread():
            with _timed(stage_ms, "predict"):
                self._filter.propagate(motion)
                headings = self._filter.heading_hypotheses(offset)
            with _timed(stage_ms, "observe"):
                votes, found = self._observe(image, headings)
            with _timed(stage_ms, "update"):
                self._filter.update(votes, offset)
            self._clock.fuse(timestamp)
            self._forced = False
            return self._estimate([note, found], votes, stage_ms)

    def force_update(self) -> None:
        """Let the next image count, whatever the motion gate says: for a robot that stands and is to look again."""
        self._forced = True

    @property
    def particles(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Poses (n, 3) and weights (n,) of the belief, to be looked at only; n = 0 in a mode without particles."""
        poses, weights = self._filter.particles()
        return self._mount.base_poses(poses), weights

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

    def _observe(self, image: NDArray[Any] | ImageError, headings: NDArray[np.float64] | None) -> tuple[VoteField, Finding]:
        """Vote field of an image, and what is wrong with it; one that cannot be used gives a field that is silent."""
        try:
            if isinstance(image, ImageError):
                raise image
            votes = self._observation.observe(self._unwrap(image), headings)
            # Only an image that was held against the map has a confidence.
            reason = Reason.IMAGE_BLANK if math.isnan(votes.confidence) else Reason.FITS_NOWHERE
        except ImageError as error:
            asked = np.zeros(1) if headings is None else headings
            votes = silent_field(asked, self._observation.places, str(error), full_circle=headings is None)
            reason = Reason.IMAGE_UNUSABLE
        if votes.informative:
            self._sightings.counted()
            return votes, Finding()
        self.images_skipped += 1
        self._sightings.left_out(reason)
        return votes, Finding(votes.problem, reason)

    def _estimate(self, findings: list[Finding], votes: VoteField | None, stage_ms: dict[str, float]) -> Estimate:
        with _timed(stage_ms, "estimate"):
            state = self._filter.state().of_point(-self._mount.offset)
        best, now = state.clusters[0], self._clock.now
        # A belief that an image was left out of may stand at an old time.
        outdated = votes is None and now is not None and self._odometry.newest > now
        since = self._odometry.motion(now, self._odometry.newest) if now is not None and outdated else None
        status, doubt = self._sightings.judge(state.status, since)
        found = [finding for finding in (*findings, self._news_of_odometry(), doubt) if finding]
        reasons = dict.fromkeys(finding.reason for finding in found if finding.reason is not None)
        return Estimate(
            timestamp=math.nan if now is None else now,
            pose=best.pose,
            covariance=best.covariance,
            status=status,
            message="; ".join(found),
            state=state,
            vote_field=votes,
            stage_ms=stage_ms,
            reasons=tuple(reasons),
        )

    def _news_of_odometry(self) -> Finding:
        """What odometry was left out since the last answer, and what else befell it."""
        parts, counts = [], {}
        for reason, count in self._odometry.rejected.items():
            counts[reason] = count
            new = count - self._reported.get(reason, 0)
            if new:
                parts.append(f"{new} odometry measurement{'s' if new > 1 else ''} left out ({reason})")
        for event, count in self._odometry.events.items():
            counts[event] = count
            if count > self._reported.get(event, 0):
                parts.append(f"odometry: {event}")
        self._reported = counts
        return Finding(", ".join(parts), Reason.ODOMETRY_LEFT_OUT)

    def save_state(self, path: str | Path) -> None:
        """Save all that the next estimate depends on, whole or not at all: a localizer that loads it goes on to the last bit.

        Parameters
        ----------
        path : str or Path
            An npz file.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        filter_arrays, filter_header = self._filter.snapshot()
        odometry_arrays, odometry_header = self._odometry.snapshot()
        arrays = {f"filter.{name}": array for name, array in filter_arrays.items()}
        arrays |= {f"odometry.{name}": array for name, array in odometry_arrays.items()}
        header = {
            "format": STATE_FORMAT,
            "map": self._map_fingerprint(),
            "settings": _that_count(self.config),
            "filter": filter_header,
            "odometry": odometry_header,
            "clock": self._clock.snapshot(),
            "sightings": self._sightings.snapshot(),
            "reported": self._reported,
            "forced": self._forced,
            "images_skipped": self.images_skipped,
        }
        write_arrays(Path(path), header, arrays)

    def load_state(self, path: str | Path) -> None:
        """Go on from a saved state; this localizer's start pose and seed no longer matter.

        Parameters
        ----------
        path : str or Path
            From `save_state`, with the same map and the same settings of observation and localizer.

        Raises
        ------
        StateError
            Missing or damaged, or saved with another map, other settings or another version. This localizer is then as before.
        """
        try:
            header, arrays = read_arrays(Path(path))
        except FileNotFoundError:
            raise StateError(f"{path}: no such file; check the path") from None
        except (OSError, ValueError) as error:
            raise StateError(f"{path}: not a saved state ({error}); start anew and save it again") from error
        if header.get("format") != STATE_FORMAT:
            raise StateError(f"{path}: format is {header.get('format')!r}, this version reads '{STATE_FORMAT}'; start anew")
        if header.get("map") != self._map_fingerprint():
            raise StateError(f"{path}: saved with another map than '{self._map.name}'; load the map that it was saved with")
        different = _first_difference(header.get("settings"), _that_count(self.config))
        if different:
            raise StateError(f"{path}: saved with {different}; use the settings that it was saved with, or start anew")
        try:
            self._take_over(header, arrays)
        except (LookupError, ValueError, TypeError, AttributeError) as error:
            raise StateError(f"{path}: the saved state is damaged ({error}); start anew and save it again") from error

    def _take_over(self, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        def part(name: str) -> dict[str, NDArray[Any]]:
            return {key.removeprefix(f"{name}."): array for key, array in arrays.items() if key.startswith(f"{name}.")}

        odometry = OdometryBuffer(self.settings.motion)
        odometry.restore(part("odometry"), header["odometry"])
        clock = ImageClock(self.settings.motion, odometry)
        clock.restore(header["clock"])
        sightings = Sightings(self.settings.status)
        sightings.restore(header["sightings"])
        values = {f"_{name}": header[name] for name in ("reported", "forced")}
        skipped = int(header["images_skipped"])
        # The last that can fail; it changes nothing if it does.
        self._filter.restore(part("filter"), header["filter"])
        vars(self).update(values)
        self._odometry, self._clock, self._sightings, self.images_skipped = odometry, clock, sightings, skipped

    def _map_fingerprint(self) -> str:
        references = self._map.references
        digest = hashlib.sha256(json.dumps([self._map.name, self._map.seed]).encode())
        for array in (references.pixels, references.positions, self._observation.places.positions):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


def _that_count(config: LocalizerConfig) -> dict[str, Any]:
    """The settings that a saved state depends on: not where it began, nor how many threads work."""
    settings = config.model_dump(mode="json")
    settings["localizer"].pop("initial")
    settings["localizer"].pop("initial_heading_error_deg")
    settings["localizer"]["monte_carlo"].pop("threads")
    return {name: settings[name] for name in ("observation", "localizer")}


def _first_difference(saved: Any, now: Any, key: str = "") -> str:
    """The first setting that differs, as ``key = saved, now this``; empty when none does."""
    if isinstance(saved, dict) and isinstance(now, dict):
        parts = (
            _first_difference(saved.get(name), now.get(name), f"{key}.{name}" if key else name) for name in {**saved, **now}
        )
        return next((part for part in parts if part), "")
    return "" if saved == now else f"{key or 'settings'} = {json.dumps(saved)}, now {json.dumps(now)}"


def _start(settings: LocalizerSettings, start_pose: tuple[float, float, float] | None, mount: Mount) -> Start:
    """What is known of the camera's pose; what is given is the base's."""
    initial = settings.initial
    if isinstance(initial, InitialPose):
        x, y, heading = mount.camera_poses([initial.x, initial.y, math.radians(initial.heading_deg)]).tolist()
        return Start((x, y), heading, initial.sd_position_m, math.radians(initial.sd_heading_deg))
    if initial == "uniform":
        return Start()
    if start_pose is None:
        raise ConfigError(
            f"localizer.initial = {initial}: needs a start pose (a sequence with ground truth, or the argument start_pose); "
            "give a mapping x, y, heading_deg, or use uniform"
        )
    pose = planar_pose(start_pose, "start_pose")
    if not is_possible(pose):
        raise ConfigError(f"start_pose = {start_pose}: no robot can be there; give x, y in metres and the heading in radians")
    x, y, heading = mount.camera_poses(pose).tolist()
    return Start((x, y) if initial == "known_pose" else None, heading + math.radians(settings.initial_heading_error_deg))


@contextmanager
def _timed(stage_ms: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    try:
        yield
    finally:
        stage_ms[stage] = 1e3 * (time.perf_counter() - begin)
