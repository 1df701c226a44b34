"""A small furnished room, rendered without any outside data: a stand-in to try things on."""

from panoloc_mcl.datasets.room.build import build_room
from panoloc_mcl.datasets.room.drive import noisy_odometry, wander
from panoloc_mcl.datasets.room.light import LIGHTS, Light
from panoloc_mcl.datasets.room.render import RoomRenderer
from panoloc_mcl.datasets.room.scene import Box, Pane, Room, furnished_room

__all__ = [
    "LIGHTS",
    "Box",
    "Light",
    "Pane",
    "Room",
    "RoomRenderer",
    "build_room",
    "furnished_room",
    "noisy_odometry",
    "wander",
]
