"""Maps of drives with odometry: keyframes along the way, loops, meetings, and a pose graph over all."""

from panoloc_mcl.robot.map.drives.drive import Drive, check_drives

__all__ = ["Drive", "check_drives"]
