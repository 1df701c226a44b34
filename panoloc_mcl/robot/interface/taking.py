"""What takes messages one at a time: a localizer on one map, or on several."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.interface.messages import Image, Message, Odometry


class TakesMessages(ABC):
    """Takes odometry and images, each by a call of its own, or as messages."""

    @abstractmethod
    def add_odometry(
        self, timestamp: float, pose: ArrayLike, velocity: ArrayLike | None = None, covariance: ArrayLike | None = None
    ) -> bool:
        """Take one odometry measurement; returns whether it was taken."""

    @abstractmethod
    def add_image(self, timestamp: float, image: NDArray[Any] | ImageError) -> Estimate | None:
        """Take one image."""

    def add(self, message: Message) -> Estimate | None:
        """Take a message of a recording or of a robot; a `Truth` is not looked at."""
        if isinstance(message, Odometry):
            self.add_odometry(message.timestamp, message.pose, message.velocity, message.covariance)
        elif isinstance(message, Image):
            return self.add_image(message.timestamp, message.pixels())
        return None
