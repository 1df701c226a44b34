"""A robot that drives on and on, and whose sensors fail at random."""

from __future__ import annotations

from collections.abc import Iterator

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

_ODOMETRY_S = 0.2
# Chances of a fault at an image: in its pixels, in its stamp, in the odometry up to it; and of being carried off.
_IN_IMAGE, _IN_STAMP, _IN_ODOMETRY, _CARRIED_OFF = 0.12, 0.05, 0.05, 0.005
# Of every fault of every image there are so many.
_VARIANTS = 2


class World:
    """A robot that drives recorded ways to and fro, with faulty sensors."""

    def __init__(self, drives: list[Sequence], rng: np.random.Generator) -> None:
        self._drives, self._rng = drives, rng
        self._drive = drives[0]
        self._frame, self._direction = 0, 1
        self._clock, self._reported = 1000.0, np.zeros(3)
        self._images: dict[tuple[str, int], Image] = {}
        self._spoilt_images: dict[tuple[str, int, str, int], Image] = {}
        self._truth = {drive.name: drive.groundtruth.at(drive.times) for drive in drives if drive.groundtruth is not None}
        self._pending: list[tuple[float, Image]] = []
        self._frozen_image: Image | None = None
        self._odometry_frozen = 0
        self._sent: list[float] = [self._clock]
        self._next: tuple[float, Image] | None = None

    @property
    def pose(self) -> Float64:
        """Where the robot is, (3,)."""
        return np.asarray(self._truth[self._drive.name][self._frame])

    def step(self, localizer: Localizer) -> Iterator[str]:
        """Drive on to the next image; yields the faults that happen."""
        rng = self._rng
        before = self.pose
        carried = rng.random() < _CARRIED_OFF
        if carried:
            self._drive = self._drives[int(rng.integers(len(self._drives)))]
            self._frame = int(rng.integers(len(self._drive)))
            yield KIDNAP
        else:
            if not 0 <= self._frame + self._direction < len(self._drive):
                self._direction = -self._direction
            self._frame += self._direction
        if rng.random() < _CARRIED_OFF:
            self._clock += 500.0
            yield CLOCK
        moved = np.zeros(3) if carried else between(before, self.pose)
        yield from self._drive_on(localizer, moved)
        yield from self._take_image()

    def look(self, localizer: Localizer) -> Estimate | None:
        """Give the localizer the image, if one arrives."""
        if self._next is None:
            return localizer.add_image(float("nan"), np.zeros((1, 1), np.uint8))
        stamp, image = self._next
        return localizer.add_image(stamp, image)

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
        for step in range(1, steps + 1):
            self._clock += _ODOMETRY_S
            pose = compose(self._reported, moved * noise * (step / steps))
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
        rng, stamp = self._rng, self._clock - 0.02
        image = self._image()
        if rng.random() < _IN_IMAGE:
            names = [*IMAGE_FAULTS, FROZEN]
            name = names[int(rng.integers(len(names)))]
            yield name
            last = image if self._frozen_image is None else self._frozen_image
            image = last if name == FROZEN else self._spoilt(name, int(rng.integers(_VARIANTS)))
        self._frozen_image = self._image()
        self._next = (stamp, image)
        if rng.random() < _IN_STAMP:
            name = STAMP_FAULTS[int(rng.integers(len(STAMP_FAULTS)))]
            yield name
            if name in ("image missing", "images reordered"):
                # What was held back comes, late, in the place of the next one that is.
                self._pending.append(self._next)
                late = self._pending.pop(0) if name == "images reordered" and len(self._pending) > 1 else None
                self._next = late
            else:
                stamps = {
                    "stamp twice": self._sent[-1],
                    "stamp not finite": float("nan"),
                    "stamp 60 s ahead": stamp + 60.0,
                    "stamp 0.5 s late": stamp - 0.5,
                }
                self._next = (stamps[name], image)
        self._pending = self._pending[-2:]
        if self._next is not None and np.isfinite(self._next[0]):
            self._sent = [self._next[0]]

    def _spoilt(self, fault: str, variant: int) -> Image:
        """The image of now with a fault; one of a few of its kind, so that a million images are some thousand different ones."""
        key = (self._drive.name, self._frame, fault, variant)
        if key not in self._spoilt_images:
            rng = np.random.default_rng([variant, self._frame, *fault.encode()])
            self._spoilt_images[key] = IMAGE_FAULTS[fault](self._image(), rng)
        return self._spoilt_images[key]

    def _image(self) -> Image:
        key = (self._drive.name, self._frame)
        if key not in self._images:
            self._images[key] = read_image(self._drive.files[self._frame])
        return self._images[key]
