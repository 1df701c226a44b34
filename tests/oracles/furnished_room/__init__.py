"""A small furnished room, drawn by ray casting in a second: a world of any size for tests."""

from oracles.furnished_room.build import build_room
from oracles.furnished_room.drive import noisy_odometry, wander
from oracles.furnished_room.light import LIGHTS, Light
from oracles.furnished_room.render import RoomRenderer
from oracles.furnished_room.scene import Box, Pane, Room, furnished_room

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
