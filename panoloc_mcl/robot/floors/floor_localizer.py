"""Localization on several maps at once. The page: images go to the localizers of the maps, and what they answer tells the map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.camera import Camera, Unwrapper
from panoloc_mcl.robot.errors import ConfigError, ImageError
from panoloc_mcl.robot.filters import Estimate, Status
from panoloc_mcl.robot.filters.shared_error import new_share
from panoloc_mcl.robot.floors.belief import FloorBelief, how_well_each_fits
from panoloc_mcl.robot.floors.saved_floors import SavedFloors
from panoloc_mcl.robot.floors.transitions import Transition
from panoloc_mcl.robot.interface.answers import Location, TimedPose
from panoloc_mcl.robot.interface.taking import TakesMessages
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.locks import Lock, locked
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.reasons import Reason
from panoloc_mcl.robot.settings.config import LocalizerConfig
from panoloc_mcl.robot.synthesis.spacing import usual_spacing

Float64 = NDArray[np.float64]

# A map that is so probable is taken for the one; the others look at every so many-th image once it is nearly certain.
_SURE, _CERTAIN, _ASKED_EVERY = 0.95, 0.99, 5
# A map that fits by this share as well as the best one looks alike, and sees every image.
_LOOKS_ALIKE = 0.02
# Without an image that counted for so long, s, a robot may have taken a lift that nobody told of, with this probability.
_UNSEEN_S, _RIDDEN = 5.0, 0.5
# Maps of this probability or more are named while it cannot be told.
_NAMED = 0.05


class FloorLocalizer(SavedFloors, TakesMessages):
    """Tells a robot on which of several maps it is, and where on it.

    Every map has a localizer of its own. While the map is not known, all of them see every image; the status is ``ambiguous``, and the
    message names the maps, until one is clearly the most probable. Fed like a `Localizer`; ``Estimate.map`` names the map that the
    pose is in.

    Parameters
    ----------
    maps : mapping of str to PanoramaMap
        By their names, such as floors.
    config : LocalizerConfig
    transitions : sequence of Transition
        Lifts and doors, if they are known; a robot is found on any map without them, too, a few images later.
    camera, image_size
        As of `Localizer`.

    Raises
    ------
    ConfigError
        No map, or a transition between maps that are not there.
    MapError, CameraError
        As `Localizer`.
    """

    def __init__(
        self,
        maps: Mapping[str, PanoramaMap],
        config: LocalizerConfig | None = None,
        transitions: Sequence[Transition] = (),
        *,
        camera: Camera | None = None,
        image_size: tuple[int, int] | None = None,
    ) -> None:
        if not maps:
            raise ConfigError("maps: there is none; name at least one")
        for transition in transitions:
            for name in transition.between:
                if name not in maps:
                    raise ConfigError(f"transitions: between = {name}: no such map; known: {', '.join(maps)}")
        config = config or LocalizerConfig()
        self.config, self.settings = config, config.localizer
        self._localizers = {
            name: Localizer(panorama_map, config, camera=camera, image_size=image_size) for name, panorama_map in maps.items()
        }
        self._names = tuple(maps)
        self._transitions = tuple(transitions)
        self._belief = FloorBelief(self._names)
        self._estimates: dict[str, Estimate] = {}
        self._images = 0
        self._seen: tuple[str, Float64] | None = None
        # When an image counted last, seconds; and whether another map looked like the most probable one.
        self._counted = math.nan
        self._alike = True
        self._lock = Lock()

    @property
    def map_name(self) -> str:
        """The most probable map."""
        return self._names[self._belief.best]

    @property
    def probabilities(self) -> dict[str, float]:
        """Of the maps."""
        return dict(zip(self._names, self._belief.probabilities.tolist(), strict=True))

    @property
    def localizer(self) -> Localizer:
        """That of the most probable map."""
        return self._localizers[self.map_name]

    def add_odometry(
        self, timestamp: float, pose: ArrayLike, velocity: ArrayLike | None = None, covariance: ArrayLike | None = None
    ) -> bool:
        """As `Localizer.add_odometry`."""
        taken = [one.add_odometry(timestamp, pose, velocity, covariance) for one in self._localizers.values()]
        return all(taken)

    @locked
    def add_image(self, timestamp: float, image: NDArray[Any] | ImageError) -> Estimate | None:
        """Take one image (see `Localizer.add_image`); the estimate is that of the most probable map."""
        self._images += 1
        ways, best = self._ways(), self.map_name
        answers = {best: self._localizers[best].add_image(timestamp, image)}
        carried = self._carried_off(answers[best])
        if ways or carried >= _RIDDEN or not self._needs_no_other(answers[best]):
            answers |= {name: self._localizers[name].add_image(timestamp, image) for name in self._names if name != best}
        self._estimates |= {name: estimate for name, estimate in answers.items() if estimate is not None}
        if all(estimate is None for estimate in answers.values()):
            return None
        if not _counts(answers[best]) and any(_counts(answer) for answer in answers.values()):
            # It fits another map, and this one nowhere.
            carried = max(carried, _RIDDEN)
        self._belief.predict(ways, carried)
        if len(answers) == 1 < len(self._names):
            return self._judged(answers)
        fields = [None if (answer := answers.get(name)) is None else answer.vote_field for name in self._names]
        fits = how_well_each_fits(fields)
        self._alike = int(np.count_nonzero(fits > _LOOKS_ALIKE)) > 1
        self._belief.update(fits, max(self._new_since_last(), carried))
        return self._judged(answers)

    def _needs_no_other(self, answer: Estimate | None) -> bool:
        """Whether the answer on the most probable map is enough, and the other maps need not see the image."""
        if self._alike or self._belief.probabilities.max() < _CERTAIN or self._images % _ASKED_EVERY == 0:
            return False
        return answer is None or (answer.status is Status.CONVERGED and _counts(answer))

    def _carried_off(self, answer: Estimate | None) -> float:
        """Probability that the robot is not where odometry led: by the image, or as nothing was seen for long."""
        if answer is None:
            return 0.0
        before, counts = self._counted, _counts(answer)
        if counts:
            self._counted = answer.timestamp
        if answer.status is Status.LOST:
            return 1.0
        elsewhere = 0.0 if math.isnan(answer.state.elsewhere) else answer.state.elsewhere
        unseen = counts and answer.timestamp - before > _UNSEEN_S
        return max(elsewhere, _RIDDEN if unseen else 0.0)

    def _ways(self) -> dict[int, int]:
        """Other maps that the robot may be on when the next image comes, by the map where it is near a transition."""
        ways = {}
        for name, estimate in self._estimates.items():
            for transition in self._transitions:
                other = transition.leads_to(name, estimate.pose) if estimate.status is Status.CONVERGED else None
                if other is not None:
                    ways[self._names.index(name)] = self._names.index(other)
        return ways

    def _new_since_last(self) -> float:
        """How much of an image is new, by the way from the last one that all maps saw: a robot that stands sees the same again."""
        best = self.map_name
        pose = self._estimates[best].pose if best in self._estimates else None
        before, self._seen = self._seen, None if pose is None else (best, pose)
        if before is None or pose is None or before[0] != best:
            return 1.0
        spacing = usual_spacing(self.localizer.panorama_map.references.positions)
        return new_share(math.hypot(*(pose - before[1])[:2].tolist()), spacing)

    def _judged(self, answers: Mapping[str, Estimate | None]) -> Estimate | None:
        """The answer on the most probable map; ambiguous while another one may be right."""
        best = self.map_name
        estimate = answers.get(best) or self._estimates.get(best)
        if estimate is None:
            return None
        estimate = replace(estimate, map=best)
        if self._belief.probabilities.max() >= _SURE or estimate.status is not Status.CONVERGED:
            return estimate
        named = sorted(((share, name) for name, share in self.probabilities.items() if share >= _NAMED), reverse=True)
        where = " or ".join(f"{name} ({100.0 * share:.0f} %)" for share, name in named)
        message = "; ".join(part for part in (estimate.message, f"the robot may be on {where}") if part)
        reasons = (*estimate.reasons, Reason.MAP_CANNOT_TELL)
        return replace(estimate, status=Status.AMBIGUOUS, message=message, reasons=tuple(dict.fromkeys(reasons)))

    def pose_at(self, timestamp: float | None = None) -> TimedPose | None:
        """As `Localizer.pose_at`, on the most probable map; not called converged while the map is not known."""
        return self._as_sure_as_the_map(self.localizer.pose_at(timestamp))

    def odometry_to_map(self, timestamp: float | None = None) -> TimedPose | None:
        """As `Localizer.odometry_to_map`, and as sure as `pose_at`."""
        return self._as_sure_as_the_map(self.localizer.odometry_to_map(timestamp))

    def _as_sure_as_the_map(self, robot: TimedPose | None) -> TimedPose | None:
        if robot is not None and robot.status is Status.CONVERGED and self._belief.probabilities.max() < _SURE:
            return replace(robot, status=Status.AMBIGUOUS)
        return robot

    def driven(self, timestamp: float) -> Float64 | None:
        """As `Localizer.driven`."""
        return self.localizer.driven(timestamp)

    @property
    def has_fix(self) -> bool:
        """As `Localizer.has_fix`, on the most probable map, once that is the one."""
        return self.localizer.has_fix and bool(self._belief.probabilities.max() >= _SURE)

    def force_update(self) -> None:
        """As `Localizer.force_update`."""
        for localizer in self._localizers.values():
            localizer.force_update()

    @locked
    def locate(self, image: NDArray[Any]) -> Location:
        """Where one image was taken, by itself (see `Localizer.locate`): on the map that it fits best.

        The confidence is that of the pose on this map times the map's share of what the image fits on all of them.

        Raises
        ------
        ImageError
            Another size or type than the camera delivers.
        """
        found = [localizer.locate(image) for localizer in self._localizers.values()]
        fits = how_well_each_fits([location.vote_field for location in found])
        best = int(np.argmax(fits))
        share = float(fits[best] / fits.sum())
        return replace(found[best], map=self._names[best], confidence=share * found[best].confidence)

    @locked
    def load_map(self, name: str, panorama_map: PanoramaMap, keep_pose: bool = False) -> None:
        """Go on with another map in the place of one of these (see `Localizer.load_map`).

        What is known of where the robot is stays, unless it is on this map and its pose there is not kept: then it may be on any.

        Raises
        ------
        ConfigError
            No such map.
        MapError, CameraError
            The map does not fit the camera or the settings. All maps are then as before.
        """
        self._known(name, "load_map").load_map(panorama_map, keep_pose)
        self._estimates.pop(name, None)
        if name == self.map_name and not keep_pose:
            self._belief, self._seen = FloorBelief(self._names), None

    def _known(self, name: str, asked_by: str) -> Localizer:
        if name not in self._localizers:
            raise ConfigError(f"{asked_by}: {name}: no such map; known: {', '.join(self._names)}")
        return self._localizers[name]

    @locked
    def set_pose(self, name: str, pose: ArrayLike, covariance: ArrayLike | None = None, timestamp: float | None = None) -> None:
        """Believe a map and a pose on it, that somebody gives.

        Raises
        ------
        ConfigError
            No such map.
        MeasurementError
            As `Localizer.set_pose`.
        """
        self._known(name, "set_pose").set_pose(pose, covariance, timestamp)
        self._belief = FloorBelief(self._names, np.where(np.array(self._names) == name, 1.0, 0.0))
        # Where it was seen before, perhaps at a lift, it no longer is.
        self._estimates, self._seen = {}, None

    @locked
    def relocalize(self) -> None:
        """Forget map and pose."""
        for localizer in self._localizers.values():
            localizer.relocalize()
        self._belief, self._seen = FloorBelief(self._names), None
        self._estimates = {}

    @property
    def particles(self) -> tuple[Float64, Float64]:
        """Of the most probable map (see `Localizer.particles`)."""
        return self.localizer.particles

    @property
    def places(self) -> Places:
        """Of the most probable map."""
        return self.localizer.places

    @property
    def panorama_map(self) -> PanoramaMap:
        """The most probable one."""
        return self.localizer.panorama_map

    @property
    def unwrapper(self) -> Unwrapper:
        """That makes panoramas of the camera's images."""
        return self.localizer.unwrapper

    @property
    def counts(self) -> dict[str, int]:
        """As `Localizer.counts`, of the most probable map; and the images of all."""
        return self.localizer.counts | {"images": self._images}


def _counts(answer: Estimate | None) -> bool:
    """Whether an image says anything of a map."""
    return answer is not None and answer.vote_field is not None and answer.vote_field.informative
