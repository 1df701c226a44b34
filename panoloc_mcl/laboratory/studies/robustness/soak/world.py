"""A robot that drives on and on, and whose sensors fail at random."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.studies.robustness.soak.faults import (
    CLOCK,
    FROZEN,
    IMAGE_FAULTS,
    KIDNAP,
    ODOMETRY_FAULTS,
    STAMP_FAULTS,
    Image,
)
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.tools.datasets import Sequence, read_image

Float64 = NDArray[np.float64]

# Odometry comes so often, and images are taken so long before the last one, seconds.
_ODOMETRY_S, _TAKEN_BEFORE_S = 0.2, 0.02
# Chances of a fault at an image: in its pixels, in its stamp, in the odometry up to it; and of being carried off.
_IN_IMAGE, _IN_STAMP, _IN_ODOMETRY, _CARRIED_OFF = 0.12, 0.05, 0.05, 0.005
# Of every fault of every image there are so many.
_VARIANTS = 2
# Answers are of times so many images ago at the most.
_STEPS_KEPT = 50


class _Key(NamedTuple):
    """An image: a frame of a drive, as it is, or with one of so many variants of a fault."""

    drive: str
    frame: int
    fault: str = ""
    variant: int = 0


class _Step(NamedTuple):
    """From one image to the next: driven evenly, or carried off at the end."""

    begin: float
    end: float
    pose: Float64
    moved: Float64


class World:
    """A robot that drives recorded ways to and fro, with faulty sensors."""

    def __init__(self, drives: list[Sequence], rng: np.random.Generator) -> None:
        self._drives, self._rng = {drive.name: drive for drive in drives}, rng
        self._drive = drives[0]
        self._frame, self._direction = 0, 1
        self._clock, self._reported = 1000.0, np.zeros(3)
        self._images: dict[_Key, Image] = {}
        self._truth = {drive.name: drive.groundtruth.at(drive.times) for drive in drives if drive.groundtruth is not None}
        self._seen: _Key | None = None
        self._odometry_frozen = 0
        self._sent = self._clock
        self._arriving: list[tuple[float, Image]] = []
        self._held_up: list[tuple[float, _Key]] = []
        self._steps: deque[_Step] = deque(maxlen=_STEPS_KEPT)

    @property
    def pose(self) -> Float64:
        """Where the robot is, (3,)."""
        return np.asarray(self._truth[self._drive.name][self._frame])

    def pose_at(self, timestamp: float) -> Float64:
        """Where the robot was at a time by its clock, (3,); where it is if that is not finite."""
        for step in self._steps:
            if timestamp < step.end:
                share = max(timestamp - step.begin, 0.0) / (step.end - step.begin)
                return compose(step.pose, share * step.moved)
        return self.pose

    @property
    def different(self) -> int:
        """How many images there are, with every fault."""
        return sum(len(drive) for drive in self._drives.values()) * (1 + _VARIANTS * len(IMAGE_FAULTS))

    def images(self) -> Iterator[Image]:
        """Every image that there is, as it is and with every fault."""
        for name, drive in self._drives.items():
            for frame in range(len(drive)):
                yield self._image(_Key(name, frame))
                for fault in IMAGE_FAULTS:
                    yield from (self._image(_Key(name, frame, fault, variant)) for variant in range(_VARIANTS))

    def step(self, localizer: Localizer) -> Iterator[str]:
        """Drive on to the next image; yields the faults that happen."""
        rng = self._rng
        before = self.pose
        carried = rng.random() < _CARRIED_OFF
        if carried:
            self._drive = list(self._drives.values())[int(rng.integers(len(self._drives)))]
            self._frame = int(rng.integers(len(self._drive)))
            yield KIDNAP
        else:
            if not 0 <= self._frame + self._direction < len(self._drive):
                self._direction = -self._direction
            self._frame += self._direction
        if rng.random() < _CARRIED_OFF:
            self._clock += 500.0
            yield CLOCK
        moved, begin = np.zeros(3) if carried else between(before, self.pose), self._clock
        yield from self._drive_on(localizer, moved)
        # The image of now is stamped as it is taken.
        self._steps.append(_Step(begin, self._clock - _TAKEN_BEFORE_S, before, moved))
        yield from self._take_image()

    def look(self, localizer: Localizer) -> Iterator[Estimate | None]:
        """Give the localizer the images that arrive: one mostly; none if it is missing; two if the one before was held up."""
        for stamp, image in self._arriving:
            yield localizer.add_image(stamp, image)

    def _drive_on(self, localizer: Localizer, moved: Float64) -> Iterator[str]:
        rng = self._rng
        fault = ODOMETRY_FAULTS[int(rng.integers(len(ODOMETRY_FAULTS)))] if rng.random() < _IN_ODOMETRY else ""
        if fault:
            yield fault
        if fault == "odometry frozen":
            self._odometry_frozen = 3
        if fault == "odometry reset":
            self._reported = np.zeros(3)
        steps = max(int(rng.uniform(0.5, 1.5) / _ODOMETRY_S), 2)
        noise = 1.0 + 0.05 * rng.standard_normal(3)
        way = compose(self._reported, moved * noise * (np.arange(1, steps + 1) / steps)[:, None])
        for step, pose in enumerate(way, 1):
            self._clock += _ODOMETRY_S
            if fault == "odometry missing":
                continue
            if self._odometry_frozen:
                pose = self._reported
            if fault == "odometry not finite" and step % 2:
                pose = np.array([np.nan, pose[1], pose[2]])
            if fault == "odometry infinite" and step % 2:
                pose = np.array([np.inf, -np.inf, 1e308])
            if fault == "odometry jumps" and step == steps // 2:
                pose = pose + np.array([50.0, -20.0, 2.0])
            localizer.add_odometry(self._clock, pose)
        if not self._odometry_frozen:
            self._reported = compose(self._reported, moved * noise)
        self._odometry_frozen = max(self._odometry_frozen - 1, 0)

    def _take_image(self) -> Iterator[str]:
        rng, stamp = self._rng, self._clock - _TAKEN_BEFORE_S
        shown = seen = _Key(self._drive.name, self._frame)
        if rng.random() < _IN_IMAGE:
            names = [*IMAGE_FAULTS, FROZEN]
            name = names[int(rng.integers(len(names)))]
            yield name
            shown = (self._seen or seen) if name == FROZEN else seen._replace(fault=name, variant=int(rng.integers(_VARIANTS)))
        self._seen = seen
        held_up, self._held_up = self._held_up, []
        arriving = [(stamp, shown)]
        if rng.random() < _IN_STAMP:
            name = STAMP_FAULTS[int(rng.integers(len(STAMP_FAULTS)))]
            yield name
            if name == "images reordered":
                self._held_up, arriving = arriving, []
            elif name == "image missing":
                arriving = []
            else:
                stamps = {
                    "stamp twice": self._sent,
                    "stamp not finite": float("nan"),
                    "stamp 60 s ahead": stamp + 60.0,
                    "stamp 0.5 s late": stamp - 0.5,
                }
                arriving = [(stamps[name], shown)]
        self._arriving = [(time, self._image(key)) for time, key in arriving + held_up]
        self._sent = next((one for one, _ in self._arriving if np.isfinite(one)), self._sent)

    def _image(self, key: _Key) -> Image:
        """One of a few of its kind if it has a fault, so that a million images are some thousand different ones."""
        if key not in self._images:
            if key.fault:
                rng = np.random.default_rng([key.variant, key.frame, *key.fault.encode()])
                self._images[key] = IMAGE_FAULTS[key.fault](self._image(_Key(key.drive, key.frame)), rng)
            else:
                self._images[key] = read_image(self._drives[key.drive].files[key.frame])
        return self._images[key]

    def snapshot(self) -> dict[str, Any]:
        """All that the next step depends on, as plain values."""
        return {
            "random": self._rng.bit_generator.state,
            "at": [self._drive.name, self._frame, self._direction],
            "clock": [self._clock, self._sent],
            "reported": self._reported.tolist(),
            "seen": self._seen,
            "odometry_frozen": self._odometry_frozen,
            "held_up": self._held_up,
            "steps": [[step.begin, step.end, step.pose.tolist(), step.moved.tolist()] for step in self._steps],
        }

    def restore(self, values: Mapping[str, Any]) -> None:
        """Take over what `snapshot` gave, of a world of the same drives."""
        self._rng.bit_generator.state = values["random"]
        name, self._frame, self._direction = values["at"]
        self._drive = self._drives[name]
        self._clock, self._sent = values["clock"]
        self._reported = np.array(values["reported"])
        self._seen = None if values["seen"] is None else _Key(*values["seen"])
        self._odometry_frozen = values["odometry_frozen"]
        self._held_up = [(stamp, _Key(*key)) for stamp, key in values["held_up"]]
        self._steps.clear()
        self._steps.extend(_Step(begin, end, np.array(pose), np.array(moved)) for begin, end, pose, moved in values["steps"])
