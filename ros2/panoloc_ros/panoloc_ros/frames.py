"""Transforms in and out, with the message type of tf2 alone: a node in AMCL's place needs no listener with a buffer.

Where ``tf2_msgs`` is not installed (the wheels that the tests run on lack it), each transform goes out by itself on ``tf_stamped`` as
``geometry_msgs/TransformStamped``, which is the same but for the list around it, and none come in.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from panoloc_mcl.tools.datasets.recordings.ros.transforms import Transforms

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

_FIXED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)


class Frames:
    """What a node has to do with tf.

    Parameters
    ----------
    node : Node
    heard : callable, optional
        Is given every ``TransformStamped`` that comes on ``/tf``.
    """

    def __init__(self, node: Node, heard: Callable[[TransformStamped], None] | None = None) -> None:
        self.fixed = Transforms()
        if TFMessage is None:
            node.get_logger().warning("tf2_msgs is not installed: transforms go out on 'tf_stamped', none come in")
            self._publisher = node.create_publisher(TransformStamped, "tf_stamped", 100)
            return
        self._publisher = node.create_publisher(TFMessage, "/tf", 100)
        node.create_subscription(TFMessage, "/tf_static", self.fixed.add, _FIXED)
        if heard is not None:

            def each(message: Any) -> None:
                for transform in message.transforms:
                    heard(transform)

            node.create_subscription(TFMessage, "/tf", each, 100)

    def send(self, transform: TransformStamped) -> None:
        """Publish a transform."""
        self._publisher.publish(transform if TFMessage is None else TFMessage(transforms=[transform]))
