"""Several maps at once, such as the floors of a building: which one the robot is on, and where on it."""

from panoloc_mcl.robot.floors.belief import FloorBelief, how_well_each_fits
from panoloc_mcl.robot.floors.floor_localizer import FloorLocalizer
from panoloc_mcl.robot.floors.transitions import Transition
from panoloc_mcl.robot.localizer import Localizer

#: What a robot's program asks: a localizer on one map, or on several.
AnyLocalizer = Localizer | FloorLocalizer

__all__ = ["AnyLocalizer", "FloorBelief", "FloorLocalizer", "Transition", "how_well_each_fits"]
