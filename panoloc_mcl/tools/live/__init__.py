"""A localizer that runs: messages in as they come, poses out at once. The core of ``panoloc live`` and of the ROS 2 node."""

from panoloc_mcl.tools.live.engine import Answer, Engine, Figures, Output

__all__ = ["Answer", "Engine", "Figures", "Output"]
