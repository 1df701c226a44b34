"""How fast images say that a robot drives, where no odometry is known: a limit that it breaks again and again is asked for in words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from panoloc_mcl.robot.reasons import Finding, Reason

# So many steps in a row are no kidnap, which is one, and no error of a single image, which is two.
_IN_ROW = 3
# Standard deviations of both images that a step may be longer.
_SPREADS = 3.0

#: Seconds, x, y and the standard deviation of the last pose, metres, and how many steps in a row were too fast.
Pace = tuple[float, float, float, float, int]


def paced(
    before: Pace | None, timestamp: float, position: Sequence[float], spread_m: float, limit_m_s: float
) -> tuple[Pace, Finding]:
    """The pace after an image, and what to say of it.

    Parameters
    ----------
    before : Pace or None
        After the image before; None where odometry is known, or nothing is.
    timestamp : float
        Seconds.
    position : (x, y)
        As this image has it, metres.
    spread_m : float
        Standard deviation of it.
    limit_m_s : float
        Speed up to which the robot is believed to drive.
    """
    x, y = float(position[0]), float(position[1])
    if before is None or timestamp <= before[0]:
        return (timestamp, x, y, spread_m, 0), Finding()
    seconds, way = timestamp - before[0], math.hypot(x - before[1], y - before[2])
    fast = before[4] + 1 if way > limit_m_s * seconds + _SPREADS * math.hypot(spread_m, before[3]) else 0
    now = (timestamp, x, y, spread_m, fast)
    if fast < _IN_ROW:
        return now, Finding()
    told = f"without odometry, {fast + 1} images in a row say that the robot drives at up to {way / seconds:.1f} m/s"
    return now, Finding(f"{told}; {Reason.FASTER_THAN_BELIEVED.remedy} ({limit_m_s:g})", Reason.FASTER_THAN_BELIEVED)
