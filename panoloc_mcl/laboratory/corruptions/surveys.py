"""Errors of surveyed poses, references along a drive, clocks that are apart, odometry of another scale."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from panoloc_mcl.laboratory.corruptions.draft import Draft, Float64, Folder, moved
from panoloc_mcl.robot.camera.spec import PanoramaCamera
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.robot.settings.validation import StrictModel
from panoloc_mcl.tools.datasets.trajectory import Trajectory
from panoloc_mcl.tools.evaluation.record import group_of

NonNegative = Annotated[float, Field(ge=0.0, le=1e3)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class AlongDrive(StrictModel):
    """References as they come when somebody drives once through the place: the frames of a drive, at its headings, unevenly apart.

    Frames nearer than ``least_m`` to the one before are left out. The gaps to the next one are drawn: ``unevenness`` is the standard
    deviation of their logarithm, and of 0 keeps every frame.
    """

    unevenness: NonNegative
    least_m: NonNegative = 0.1
    drives: Annotated[int, Field(ge=1, le=100)] = 1

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Take a drive for the references; it is driven no more.

        Raises
        ------
        ConfigError
            No drive that could be spared, or without ground truth.
        """
        groups = Counter(group_of(name) for name, drive in draft.spare.items() if drive.groundtruth is not None)
        if not groups:
            raise ConfigError(
                "along_drive: needs a sequence with ground truth beside those that are localized over; name fewer sequences"
            )
        most = max(groups, key=lambda group: (groups[group], group))
        names = [name for name in draft.spare if group_of(name) == most][: self.drives]
        shots, stamps, drives = [], [], []
        for name in names:
            way, wanted = math.inf, 0.0
            last = None
            for shot in draft.spare[name].shots:
                assert shot.pose is not None
                way += 0.0 if last is None else math.hypot(*(shot.pose[:2] - last[:2]))
                last = shot.pose
                if way >= max(wanted, self.least_m):
                    shots.append(shot)
                    stamps.append(shot.time)
                    drives.append(draft.spare[name])
                    way, wanted = 0.0, 0.3 * float(np.exp(self.unevenness * rng.standard_normal())) * (self.unevenness > 0.0)
        source = draft.spare[names[0]]
        said = [
            drive.groundtruth.at(stamp) for drive, stamp in zip(drives, stamps, strict=True) if drive.groundtruth is not None
        ]
        claimed, draft.poses_of = np.array(said), "base"
        draft.references = Folder([replace(s, time=0.0) for s in shots], source.optics, source.size, source.camera, claimed)


class Doubled(StrictModel):
    """The way led by some places twice: ``share`` of the references is there a second time, ``apart_m`` off (sd of x and of y)."""

    share: Share
    apart_m: NonNegative = 0.005

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Add the second ones."""
        references = draft.references
        chosen = rng.permutation(len(references.shots))[: round(self.share * len(references.shots))]
        again = references.claimed[chosen]
        again = again + np.pad(rng.normal(0.0, self.apart_m, (len(chosen), 2)), ((0, 0), (0, 1)))
        references.claimed = np.concatenate([references.claimed, again])
        references.sds = None if references.sds is None else np.concatenate([references.sds, references.sds[chosen]])
        references.shots += [replace(references.shots[index], copy=1) for index in chosen]


class Standing(StrictModel):
    """The robot stood still while references were taken: at ``stops`` places there are ``images`` of the same pose."""

    stops: Annotated[int, Field(ge=0, le=1000)]
    images: Annotated[int, Field(ge=1, le=1000)]

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Add the images that were taken while standing."""
        references = draft.references
        stops = set(rng.permutation(len(references.shots))[: self.stops].tolist())
        order = [
            (index, copy) for index in range(len(references.shots)) for copy in range(self.images if index in stops else 1)
        ]
        references.shots = [replace(references.shots[index], copy=copy) for index, copy in order]
        indices = [index for index, _ in order]
        references.claimed = references.claimed[indices]
        references.sds = None if references.sds is None else references.sds[indices]


class Turned(StrictModel):
    """References were taken at any heading within ``spread_deg``, by whole columns of their panoramas."""

    spread_deg: Annotated[float, Field(ge=0.0, le=360.0)]

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Turn the robot, and what it sees."""
        references = draft.references
        if not isinstance(references.optics, PanoramaCamera):
            raise ConfigError(f"turned: is for references that are panoramas; these are of kind {references.optics.kind}")
        width = references.size[0]
        columns = np.rint(rng.uniform(-0.5, 0.5, len(references.shots)) * self.spread_deg * width / 360.0).astype(int)
        sense = 1 if references.optics.columns == "clockwise" else -1
        turns = np.pad(columns[:, None] * (2.0 * np.pi / width), ((0, 0), (2, 0)))
        references.claimed = _added(references.claimed, turns)
        references.shots = [
            replace(shot, turned=sense * int(column), pose=None if shot.pose is None else _added(shot.pose, turn))
            for shot, column, turn in zip(references.shots, columns, turns, strict=True)
        ]


class PoseNoise(StrictModel):
    """Every reference's pose is off by itself: Gaussian, standard deviation of x and of y, and of the heading."""

    xy_m: NonNegative
    theta_deg: NonNegative

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Claim poses with errors."""
        claimed = draft.references.claimed
        errors = rng.standard_normal(claimed.shape) * (self.xy_m, self.xy_m, math.radians(self.theta_deg))
        draft.references.claimed = _added(claimed, errors)

    def tell(self, draft: Draft) -> None:
        """Say how well the poses are known."""
        draft.references.sds = np.tile([self.xy_m, math.radians(self.theta_deg)], (len(draft.references.claimed), 1))


class PoseDrift(StrictModel):
    """References located by dead reckoning: in the order in which they come, errors add up.

    Lengths are off by ``share`` (drawn once, sd), and the direction wanders by ``share`` radians (sd) over a metre, growing with the
    root of the way.
    """

    share: Share

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Claim poses that drift from the first one on."""
        claimed = draft.references.claimed
        steps = between(claimed[:-1], claimed[1:])
        length = np.hypot(steps[:, 0], steps[:, 1])
        steps[:, :2] *= 1.0 + self.share * rng.standard_normal()
        steps[:, 2] += self.share * np.sqrt(length) * rng.standard_normal(len(steps))
        draft.references.claimed = _chained(claimed[0], steps)


class Headings(StrictModel):
    """Nobody measured the headings of the references: they are known to ``sd_deg`` (Gaussian), and 180 is not at all."""

    sd_deg: Annotated[float, Field(ge=0.0, le=180.0)]

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Claim coarse headings, and say that they are, or claim none."""
        claimed, unknown = draft.references.claimed, self.sd_deg == 180.0
        errors = np.zeros(claimed.shape)
        errors[:, 2] = -claimed[:, 2] if unknown else math.radians(self.sd_deg) * rng.standard_normal(len(claimed))
        draft.references.claimed = _added(claimed, errors)
        sds = np.full((len(claimed), 2), np.nan) if draft.references.sds is None else draft.references.sds.copy()
        sds[:, 1] = np.inf if unknown else math.radians(self.sd_deg)
        draft.references.sds = sds


class Clock(StrictModel):
    """The clock of odometry goes ``seconds`` behind that of the images (as images that arrive late and are stamped on arrival)."""

    seconds: Annotated[float, Field(ge=-100.0, le=100.0)]

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Shift the stamps of odometry."""
        for drive in draft.drives.values():
            drive.odometry = self._shifted(drive.odometry)

    def tell(self, draft: Draft) -> None:
        """Say how far the clocks are apart; what is true is then told by odometry's."""
        for drive in draft.drives.values():
            drive.groundtruth = self._shifted(drive.groundtruth)
            drive.camera = drive.camera.model_copy(update={"time_offset_s": drive.camera.stamp_offset_s - self.seconds})

    def _shifted(self, trajectory: Trajectory | None) -> Trajectory | None:
        return None if trajectory is None else Trajectory(trajectory.times - self.seconds, trajectory.poses)


class Odometry(StrictModel):
    """Wheels that are not what they are believed to be: lengths too large by ``scale``, and a turn that creeps in."""

    scale: Annotated[float, Field(ge=-0.9, le=10.0)]
    drift_deg_per_m: Annotated[float, Field(ge=-360.0, le=360.0)]

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Report other ways."""
        for drive in draft.drives.values():
            drive.odometry = moved(drive.odometry, self._said)

    def _said(self, poses: Float64) -> Float64:
        steps = between(poses[:-1], poses[1:])
        steps[:, 2] += math.radians(self.drift_deg_per_m) * np.hypot(steps[:, 0], steps[:, 1])
        steps[:, :2] *= 1.0 + self.scale
        return _chained(poses[0], steps)


def _added(poses: Float64, errors: Float64) -> Float64:
    off = poses + errors
    off[..., 2] = wrap_angle(off[..., 2])
    return np.asarray(off)


def _chained(first: Float64, steps: Float64) -> Float64:
    path = [first]
    for step in steps:
        path.append(compose(path[-1], step))
    return np.array(path)
