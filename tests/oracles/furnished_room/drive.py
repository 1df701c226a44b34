"""A robot that wanders about the room, and what its wheels report of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from oracles.furnished_room.scene import Room

from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.tools.datasets.trajectory import Trajectory

FloatArray = NDArray[np.float64]

CLEARANCE_M = 0.4
_STEP_S = 0.05
_SPEED = 0.45  # m/s
_TURN_SPEED = 0.8  # rad/s


def wander(room: Room, duration_s: float, rng: np.random.Generator) -> Trajectory:
    """Drive straight from one random free point to the next, turning on the spot between them.

    Parameters
    ----------
    room : Room
    duration_s : float
    rng : numpy.random.Generator

    Returns
    -------
    Trajectory
        True poses in the map frame every 0.05 s from time 0, at least ``CLEARANCE_M`` from furniture and walls.
    """
    x, y = _free_point(room, rng, None)
    theta = float(rng.uniform(-math.pi, math.pi))
    target = _free_point(room, rng, (x, y))
    poses = []
    for _ in range(math.ceil(duration_s / _STEP_S) + 1):
        poses.append((x, y, theta))
        away = math.hypot(target[0] - x, target[1] - y)
        if away < _SPEED * _STEP_S:
            target = _free_point(room, rng, (x, y))
        turn = float(wrap_angle(math.atan2(target[1] - y, target[0] - x) - theta))
        most = _TURN_SPEED * _STEP_S
        theta = float(wrap_angle(theta + min(max(turn, -most), most)))
        if abs(turn) <= most:  # faces its target: drive
            x += _SPEED * _STEP_S * math.cos(theta)
            y += _SPEED * _STEP_S * math.sin(theta)
    return Trajectory(np.asarray(np.arange(len(poses)) * _STEP_S, dtype=np.float64), np.array(poses))


def noisy_odometry(
    truth: Trajectory,
    times: FloatArray,
    rng: np.random.Generator,
    translation_noise: float = 0.10,
    rotation_noise: float = 0.08,
    drift_deg_per_m: float = 1.0,
) -> Trajectory:
    """What wheel encoders make of a drive, in a frame that starts at the origin.

    Parameters
    ----------
    truth : Trajectory
    times : ndarray of float64, shape (n,)
        When the odometry reports, seconds.
    rng : numpy.random.Generator
    translation_noise, rotation_noise : float
        Standard deviation of every step's distance and turn, as a share of it.
    drift_deg_per_m : float
        Turn that creeps in with distance, to a side drawn once.
    """
    poses = truth.at(times)
    steps = between(poses[:-1], poses[1:])
    drift = math.radians(drift_deg_per_m) * float(rng.choice([-1.0, 1.0]))
    noise = rng.standard_normal((len(steps), 2))
    reported = steps.copy()
    reported[:, :2] *= 1.0 + translation_noise * noise[:, :1]
    reported[:, 2] *= 1.0 + rotation_noise * noise[:, 1]
    reported[:, 2] += drift * np.hypot(steps[:, 0], steps[:, 1])
    path = [np.zeros(3)]
    for step in reported:
        path.append(compose(path[-1], step))
    return Trajectory(times, np.array(path))


def _free_point(room: Room, rng: np.random.Generator, seen_from: tuple[float, float] | None) -> tuple[float, float]:
    """A random point that keeps its distance from everything, as does the straight way to it."""
    low, high = room.shell.low[:2], room.shell.high[:2]
    while True:
        point = rng.uniform(low, high)
        if seen_from is not None and np.hypot(*(point - seen_from)) < 0.5:
            continue
        way = point[None] if seen_from is None else np.linspace(seen_from, point, 200)
        # A little more than asked for: the way is checked at points only.
        if np.all(room.clearance(way) > CLEARANCE_M + 0.02):
            return float(point[0]), float(point[1])
