"""The loop: messages in, answers out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from panoloc_mcl.robot.filters import Estimate
from panoloc_mcl.robot.floors import AnyLocalizer
from panoloc_mcl.robot.interface.messages import Image, Message


def answers(localizer: AnyLocalizer, messages: Iterable[Message]) -> Iterator[tuple[Image, Estimate]]:
    """Feed messages to a localizer in the order that they come in; yields each image that was answered, with its estimate."""
    for message in messages:
        estimate = localizer.add(message)
        if estimate is not None:
            assert isinstance(message, Image)
            yield message, estimate
