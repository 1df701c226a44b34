"""One stream of messages, be it from a recording or from a running robot, and the one loop that feeds it to a localizer."""

from panoloc_mcl.robot.interface.messages import Image, Message, Odometry, Truth
from panoloc_mcl.tools.streams.feed import answers
from panoloc_mcl.tools.streams.recorded import recorded

__all__ = ["Image", "Message", "Odometry", "Truth", "answers", "recorded"]
