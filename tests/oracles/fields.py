"""Vote fields made by hand: smooth hills of votes over places and headings."""

import numpy as np

from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.motion import Motion
from panoloc_mcl.robot.observation import Places, VoteField

HEADINGS = 72
CIRCLE = 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS


def hills(places: Places, *poses, height: float = 0.9, tolerance: float = 0.15, width_m: float = 0.8, width_deg: float = 12.0):
    """A field with a hill at each pose (x, y, heading), the highest counting where they overlap."""
    votes = np.zeros((HEADINGS, len(places)))
    for x, y, theta in poses:
        far = np.hypot(*(places.positions - (x, y)).T) / width_m
        off = angle_difference(CIRCLE, theta) / np.radians(width_deg)
        votes = np.maximum(votes, height * np.exp(-0.5 * (far[None, :] ** 2 + off[:, None] ** 2)))
    return VoteField(votes.astype(np.float32), CIRCLE, places, tolerance * height)


def moved(dx: float, dy: float, turn: float, sd_position: float = 0.02, sd_heading: float = 0.01) -> Motion:
    """A drive with noise that is the same along and across."""
    return Motion(
        np.array([dx, dy, turn]),
        along=dx,
        across=dy,
        last_turn=turn,
        sd_along=sd_position,
        sd_across=sd_position,
        sd_last_turn=sd_heading,
        distance=float(np.hypot(dx, dy)),
        turn=abs(turn),
    )


STANDING = moved(0.0, 0.0, 0.0, 0.0, 0.0)
