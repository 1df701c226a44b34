"""The localizer: images and odometry in, poses out. This page is the algorithm."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import ThreadpoolController

from panoloc_mcl.camera import Camera
from panoloc_mcl.config.model import InitialPose, RunConfig
from panoloc_mcl.errors import ConfigError, ImageError
from panoloc_mcl.filters import Estimate, KalmanOrientationFilter, MonteCarloFilter, PoseFilter, Start
from panoloc_mcl.motion import Motion, OdometryBuffer
from panoloc_mcl.observation import ObservationModel, Places, VoteField
from panoloc_mcl.observation.field import silent_field
from panoloc_mcl.panorama_map import PanoramaMap


class Localizer:
    """Tells a robot with a panoramic camera where it is and where it looks.

    Parameters
    ----------
    panorama_map : PanoramaMap
    config : RunConfig
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
    ConfigError
        ``initial`` asks for a start pose and there is none.
    MapError, CameraError
        The map does not fit the camera.
    """

    def __init__(
        self,
        panorama_map: PanoramaMap,
        config: RunConfig | None = None,
        *,
        camera: Camera | None = None,
        image_size: tuple[int, int] | None = None,
        start_pose: tuple[float, float, float] | None = None,
        seed: int | tuple[int, ...] | None = None,
        model: ObservationModel | None = None,
    ) -> None:
        config = config or RunConfig()
        self.settings = config.localizer
        self._unwrap = panorama_map.unwrapper(camera, image_size)
        self._observation = model or panorama_map.observation_model(config.observation)
        self._odometry = OdometryBuffer(self.settings.motion)
        rng = np.random.default_rng(config.seed if seed is None else seed)
        self._filter = self._make_filter(self._observation.places, _start(self.settings.initial, start_pose), rng)
        self._time: float | None = None
        self._reported_rejections: dict[str, int] = {}
        self.images_skipped = 0
        self._blas = ThreadpoolController()

    def _make_filter(self, places: Places, start: Start, rng: np.random.Generator) -> PoseFilter:
        if self.settings.mode == "monte_carlo":
            return MonteCarloFilter(places, start, self.settings.monte_carlo, self.settings.status, rng)
        return KalmanOrientationFilter(places, start, self.settings.kalman_orientation, self.settings.status, rng)

    def add_odometry(self, timestamp: float, pose: ArrayLike) -> None:
        """Take one odometry measurement; it may come late or out of order.

        Parameters
        ----------
        timestamp : float
            Seconds.
        pose : array_like of float, shape (3,)
            x, y, heading in the odometry frame, metres and radians. One that is not finite is left out and counted.
        """
        self._odometry.add(timestamp, np.asarray(pose, dtype=np.float64))

    def add_image(self, timestamp: float, image: NDArray[Any]) -> Estimate | None:
        """Take one image as the camera delivers it.

        Parameters
        ----------
        timestamp : float
            Seconds; may be earlier than that of the image before, within the odometry that is kept.
        image : ndarray of uint8 or uint16, shape (rows, columns) or (rows, columns, 3 or 4)
            Grey, or colour in OpenCV's order.

        Returns
        -------
        Estimate or None
            None while the motion gate is shut. An image that cannot be used is skipped and counted; the estimate then rests on
            odometry alone and says why. After a late image the estimate is that of the newest image's time, bettered by the late one.
        """
        stage_ms: dict[str, float] = {}
        problem = self._stamp_problem(timestamp)
        if problem:
            self.images_skipped += 1
            return self._estimate(problem, None, stage_ms)
        motion, offset = self._motion_to(timestamp)
        if not self._gate_opens(motion if offset is None else offset):
            return None
        # One BLAS thread: products this small gain nothing from more, and sums come out the same on every machine.
        with self._blas.limit(limits=1, user_api="blas"):
            with _timed(stage_ms, "predict"):
                self._filter.propagate(motion)
                headings = self._filter.heading_hypotheses(offset)
            with _timed(stage_ms, "observe"):
                votes = self._observe(image, headings)
            with _timed(stage_ms, "update"):
                self._filter.update(votes, offset)
            self._time = timestamp if offset is None else self._time
            return self._estimate(votes.problem, votes, stage_ms)

    def _stamp_problem(self, timestamp: float) -> str:
        if not math.isfinite(timestamp):
            return "image skipped: its time stamp is not finite"
        if self._time is None or timestamp > self._time:
            return ""
        if timestamp == self._time:
            return f"image skipped: time stamp {timestamp:.9f} came twice"
        if timestamp < self._odometry.oldest:
            return f"image skipped: {self._time - timestamp:.3f} s late, before the odometry that is kept"
        return ""

    def _motion_to(self, timestamp: float) -> tuple[Motion, Motion | None]:
        """Motion of the belief up to an image; for a late one none, but the way back from the belief's time to the image's."""
        now = timestamp if self._time is None else self._time
        if timestamp < now:
            return self._odometry.motion(now, now), self._odometry.motion(now, timestamp)
        return self._odometry.motion(now, timestamp), None

    def _gate_opens(self, motion: Motion) -> bool:
        gate = self.settings.gate
        if self._time is None or gate.distance_m == gate.angle_deg == 0.0 or motion.blind_s > 0.0:
            return True
        moved = gate.distance_m > 0.0 and motion.distance >= gate.distance_m
        turned = gate.angle_deg > 0.0 and motion.turn >= math.radians(gate.angle_deg)
        return moved or turned

    def _observe(self, image: NDArray[Any], headings: NDArray[np.float64] | None) -> VoteField:
        """Vote field of an image; one that cannot be used gives a field that is silent and says why."""
        try:
            votes = self._observation.observe(self._unwrap(image), headings)
        except ImageError as error:
            asked = np.zeros(1) if headings is None else headings
            votes = silent_field(asked, self._observation.places, str(error), full_circle=headings is None)
        self.images_skipped += not votes.informative
        return votes

    def _estimate(self, problem: str, votes: VoteField | None, stage_ms: dict[str, float]) -> Estimate:
        with _timed(stage_ms, "estimate"):
            state = self._filter.state()
        best = state.clusters[0]
        message = "; ".join(part for part in (problem, self._new_rejections()) if part)
        time_of_belief = math.nan if self._time is None else self._time
        return Estimate(time_of_belief, best.pose, best.covariance, state.status, message, state, votes, stage_ms)

    def _new_rejections(self) -> str:
        parts = []
        for reason, count in self._odometry.rejected.items():
            new = count - self._reported_rejections.get(reason, 0)
            if new:
                parts.append(f"{new} odometry measurement{'s' if new > 1 else ''} left out ({reason})")
        self._reported_rejections = dict(self._odometry.rejected)
        return ", ".join(parts)


def _start(initial: str | InitialPose, start_pose: tuple[float, float, float] | None) -> Start:
    if isinstance(initial, InitialPose):
        return Start(
            (initial.x, initial.y),
            math.radians(initial.heading_deg),
            initial.sd_position_m,
            math.radians(initial.sd_heading_deg),
        )
    if initial == "uniform":
        return Start()
    if start_pose is None:
        raise ConfigError(
            f"localizer.initial = {initial}: needs a start pose (a sequence with ground truth, or the argument start_pose); "
            "give a mapping x, y, heading_deg, or use uniform"
        )
    x, y, heading = start_pose
    return Start((x, y) if initial == "known_pose" else None, heading)


@contextmanager
def _timed(stage_ms: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    try:
        yield
    finally:
        stage_ms[stage] = 1e3 * (time.perf_counter() - begin)
