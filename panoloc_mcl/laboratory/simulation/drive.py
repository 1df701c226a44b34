"""The robot's and people's ways: where there is room, and how one gets about."""

from __future__ import annotations

import heapq
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.building import Building
from panoloc_mcl.laboratory.simulation.settings import Drive, Odometry
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.tools.datasets.trajectory import Trajectory

FloatArray = NDArray[np.float64]

_CELL_M = 0.05
_STEP_S = 0.05


class FreeSpace:
    """How far every point of the floor is from the nearest thing that the robot would run into.

    Parameters
    ----------
    building : Building
    robot_height_m : float
        What begins above it is driven under.
    """

    def __init__(self, building: Building, robot_height_m: float) -> None:
        self.scene = building.scene
        areas = np.array(self.scene.drive)
        self._low, high = areas[:, :2].min(axis=0) - 1.0, areas[:, 2:].max(axis=0) + 1.0
        shape = np.ceil((high - self._low) / _CELL_M).astype(int)
        blocked = np.zeros((shape[1], shape[0]), dtype=np.uint8)
        for outline, (bottom, top) in zip(building.footprints, building.heights, strict=True):
            if bottom < robot_height_m and top > 0.05:
                # Sixteenths of a cell, so that thin things are not lost.
                corners = np.round((outline - self._low) / _CELL_M * 16.0 - 8.0).astype(np.int32)
                cv2.fillPoly(blocked, [corners], 1, shift=4)
                cv2.polylines(blocked, [corners], True, 1, shift=4)
        self._distance = cv2.distanceTransform(1 - blocked, cv2.DIST_L2, 5) * _CELL_M

    def distance(self, points: FloatArray) -> FloatArray:
        """Metres to the nearest thing from points (n, 2); 0 outside."""
        cell = np.floor((points - self._low) / _CELL_M).astype(int)
        rows, columns = self._distance.shape
        known = (cell >= 0).all(axis=-1) & (cell[..., 0] < columns) & (cell[..., 1] < rows)
        cell = np.where(known[..., None], cell, 0)
        return np.where(known, self._distance[cell[..., 1], cell[..., 0]], 0.0)

    def is_inside(self, points: FloatArray) -> NDArray[np.bool_]:
        """Whether points (n, 2) lie in one of the scene's areas to drive in."""
        inside = np.zeros(len(points), dtype=bool)
        for x0, y0, x1, y1 in self.scene.drive:
            inside |= (points[:, 0] >= x0) & (points[:, 0] <= x1) & (points[:, 1] >= y0) & (points[:, 1] <= y1)
        return inside

    def is_free(self, points: FloatArray, clearance_m: float) -> NDArray[np.bool_]:
        """Whether points (n, 2) may be driven over."""
        return self.is_inside(points) & (self.distance(points) >= clearance_m)

    def is_open(self, a: FloatArray, b: FloatArray, clearance_m: float) -> bool:
        """Whether the straight way from a to b is free."""
        count = max(2, math.ceil(float(np.hypot(*(b - a))) / 0.04))
        return bool(self.is_free(np.linspace(a, b, count), clearance_m).all())


def reference_poses(space: FreeSpace) -> FloatArray:
    """Poses (n, 3) of the references: the scene's grid, without what is too near to something.

    Raises
    ------
    ConfigError
        No place is left.
    """
    scene, places = space.scene, []
    for x0, y0, x1, y1 in scene.places.areas:
        step = scene.places.step_m
        for y in np.arange(y0, y1 + 1e-6, step):
            for x in np.arange(x0, x1 + 1e-6, step):
                place = (round(float(x), 6), round(float(y), 6))
                if place not in places:
                    places.append(place)
    grid = np.array(places)
    left = grid[space.distance(grid) >= scene.clearance_m]
    if len(left) == 0:
        raise ConfigError(
            f"scene '{scene.name}': places.areas: no place keeps clearance_m = {scene.clearance_m:g} from walls and things; "
            "move the areas or lower clearance_m"
        )
    return np.column_stack([left, np.full(len(left), math.radians(scene.places.heading_deg))])


class RoadMap:
    """The places of the references, and which are joined by a free straight way."""

    def __init__(self, space: FreeSpace, places: FloatArray) -> None:
        self.space, self.places = space, places[:, :2]
        reach = 1.45 * space.scene.places.step_m
        clearance = 0.8 * space.scene.clearance_m
        self._joined: list[list[tuple[int, float]]] = [[] for _ in self.places]
        for i, a in enumerate(self.places):
            for j in range(i + 1, len(self.places)):
                away = float(np.hypot(*(self.places[j] - a)))
                if away <= reach and space.is_open(a, self.places[j], clearance):
                    self._joined[i].append((j, away))
                    self._joined[j].append((i, away))

    def reachable(self, start: int) -> list[int]:
        """All places that can be driven to, the start among them."""
        found, open_ = {start}, [start]
        while open_:
            for other, _ in self._joined[open_.pop()]:
                if other not in found:
                    found.add(other)
                    open_.append(other)
        return sorted(found)

    def way(self, start: int, goal: int) -> list[int]:
        """The shortest way, both ends included."""
        best, before = {start: 0.0}, {start: start}
        queue = [(0.0, start)]
        while queue:
            length, at = heapq.heappop(queue)
            if at == goal:
                break
            for other, away in self._joined[at]:
                if length + away < best.get(other, math.inf):
                    best[other], before[other] = length + away, at
                    heapq.heappush(queue, (length + away, other))
        way = [goal]
        while way[-1] != start:
            way.append(before[way[-1]])
        return way[::-1]


def wander(roads: RoadMap, duration_s: float, drive: Drive, rng: np.random.Generator) -> Trajectory:
    """Drive from place to place, each drawn at random, a little beside the places on the way.

    Returns
    -------
    Trajectory
        Every 0.05 s from time 0.
    """
    space, clearance = roads.space, 0.8 * roads.space.scene.clearance_m
    start = int(rng.integers(len(roads.places)))
    known = roads.reachable(start)
    if len(known) < 2:
        return _follow([roads.places[start]], float(rng.uniform(-math.pi, math.pi)), duration_s, drive)
    points = [roads.places[start]]
    need, at = drive.speed_m_s * duration_s, start
    length = 0.0
    while length <= need:
        goal = known[int(rng.integers(len(known)))]
        for place in roads.way(at, goal)[1:]:
            aside = roads.places[place] + rng.uniform(-1.0, 1.0, 2) * drive.beside_m
            target = aside if space.is_open(points[-1], aside, clearance) else roads.places[place]
            if not space.is_open(points[-1], target, clearance):
                # From beside the last place the next one is hidden: over the place itself.
                points.append(roads.places[at])
            length += float(np.hypot(*(target - points[-1])))
            points.append(target)
            at = place
    return _follow(points, float(rng.uniform(-math.pi, math.pi)), duration_s, drive)


def patrol(space: FreeSpace, duration_s: float, drive: Drive, where: str) -> Trajectory:
    """Drive along the waypoints, again and again.

    Raises
    ------
    ConfigError
        A way that leaves the map, or leads through something.
    """
    points = [np.array(point) for point in drive.waypoints]
    faults = []
    for number, (a, b) in enumerate(zip(points, [*points[1:], points[0]], strict=True)):
        if not space.is_inside(a[None])[0]:
            faults.append(f"{where}.waypoints.{number} = {a.tolist()}: lies outside the scene's areas (drive); move it inside")
        elif not space.is_open(a, b, 0.8 * space.scene.clearance_m):
            faults.append(
                f"{where}.waypoints.{number} = {a.tolist()}: the straight way to {b.tolist()} leaves the scene's areas (drive) or "
                f"comes nearer than {0.8 * space.scene.clearance_m:g} m to something; add a waypoint"
            )
    if faults:
        raise ConfigError(faults)
    length = sum(float(np.hypot(*(b - a))) for a, b in zip(points, [*points[1:], points[0]], strict=True))
    rounds = math.ceil(drive.speed_m_s * duration_s / max(length, 1e-6)) + 1
    first = points[1] - points[0]
    return _follow(points * rounds, math.atan2(first[1], first[0]), duration_s, drive)


def turn(roads: RoadMap, duration_s: float, drive: Drive, rng: np.random.Generator) -> Trajectory:
    """Turn on the spot, at a place drawn at random."""
    at = roads.places[int(rng.integers(len(roads.places)))]
    times = np.asarray(np.arange(math.ceil(duration_s / _STEP_S) + 1) * _STEP_S, dtype=np.float64)
    theta = wrap_angle(float(rng.uniform(-math.pi, math.pi)) + math.radians(drive.turn_deg_s) * times)
    return Trajectory(times, np.column_stack([np.tile(at, (len(times), 1)), theta]))


def driven(drive: Drive, roads: RoadMap, duration_s: float, rng: np.random.Generator, where: str) -> Trajectory:
    """The robot's way, every 0.05 s from time 0.

    Raises
    ------
    ConfigError
        As `patrol`; ``where`` names the drive.
    """
    if drive.kind == "patrol":
        return patrol(roads.space, duration_s, drive, where)
    return wander(roads, duration_s, drive, rng) if drive.kind == "wander" else turn(roads, duration_s, drive, rng)


def _follow(points: list[FloatArray], theta: float, duration_s: float, drive: Drive) -> Trajectory:
    """Along straight lines, turning on the spot at every point; standing still at the last."""
    poses = []
    (x, y), target = points[0], 0
    most, step = math.radians(drive.turn_deg_s) * _STEP_S, drive.speed_m_s * _STEP_S
    for _ in range(math.ceil(duration_s / _STEP_S) + 1):
        poses.append((float(x), float(y), theta))
        while target < len(points) - 1 and math.hypot(points[target][0] - x, points[target][1] - y) < 1e-6:
            target += 1
        dx, dy = points[target][0] - x, points[target][1] - y
        away = math.hypot(dx, dy)
        if away < 1e-6:
            continue
        ahead = float(wrap_angle(math.atan2(dy, dx) - theta))
        theta = float(wrap_angle(theta + min(max(ahead, -most), most)))
        if abs(ahead) <= most:
            share = min(1.0, step / away)
            x, y = x + share * dx, y + share * dy
    return Trajectory(np.asarray(np.arange(len(poses)) * _STEP_S, dtype=np.float64), np.array(poses))


def reported(truth: Trajectory, times: FloatArray, errors: Odometry, rng: np.random.Generator) -> Trajectory:
    """What the wheels make of a drive, in a frame that starts at the origin.

    Parameters
    ----------
    truth : Trajectory
    times : ndarray of float64, shape (n,)
        When they report, seconds.
    errors : Odometry
    rng : numpy.random.Generator
    """
    poses = truth.at(times)
    steps = between(poses[:-1], poses[1:])
    drift = math.radians(errors.drift_deg_per_m) * float(rng.choice([-1.0, 1.0]))
    noise = rng.standard_normal((len(steps), 2))
    said = steps.copy()
    said[:, :2] *= 1.0 + errors.translation_noise * noise[:, :1]
    said[:, 2] *= 1.0 + errors.rotation_noise * noise[:, 1]
    said[:, 2] += drift * np.hypot(steps[:, 0], steps[:, 1])
    path = [np.zeros(3)]
    for step in said:
        path.append(compose(path[-1], step))
    return Trajectory(times, np.array(path))
