"""Renders a data set: references, and drives under many lights. What was rendered before is not rendered again."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.building import Building, build
from panoloc_mcl.laboratory.simulation.drive import FreeSpace, RoadMap, driven, reference_poses, reported, wander
from panoloc_mcl.laboratory.simulation.engine.backend import Backend, backend
from panoloc_mcl.laboratory.simulation.optics import RayTable, expose, overlaid, ray_table, read_body
from panoloc_mcl.laboratory.simulation.people import Person, Walk
from panoloc_mcl.laboratory.simulation.renderer import RayCaster
from panoloc_mcl.laboratory.simulation.scene import Scene, load_scene
from panoloc_mcl.laboratory.simulation.settings import Drive, ReferenceDrive, SequenceGroup, SimulationConfig
from panoloc_mcl.laboratory.simulation.sun import light_of
from panoloc_mcl.laboratory.simulation.world import World
from panoloc_mcl.robot.camera.spec import AnyCamera
from panoloc_mcl.robot.errors import ConfigError, DatasetError
from panoloc_mcl.robot.files import remove_unfinished, write_atomically
from panoloc_mcl.robot.images import Image, write_image
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.tools.datasets.trajectory import Trajectory
from panoloc_mcl.tools.datasets.writer import DatasetWriter

FloatArray = NDArray[np.float64]
# The share of things that have been moved, and the seed that says which.
_BuildingKey = tuple[float, int]
_AS_IT_STANDS: _BuildingKey = (0.0, 0)

MARK = ".simulation.json"
_START_S = 1000.0
_ODOMETRY_LEAD_S = 0.031  # its stamps are not those of the frames
_LEAST_FREE_BYTES = 20_000_000


@dataclass(frozen=True)
class _Shot:
    """Everything that one frame depends on."""

    pose: FloatArray
    height_m: float
    people: tuple[Person, ...]
    tilt: tuple[float, float]
    auto_exposure: bool
    key: tuple[int, ...]


@dataclass(frozen=True)
class _View:
    """What the images of a folder have in common."""

    light: str
    building: _BuildingKey
    camera: AnyCamera
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class _Sequence:
    name: str
    group: SequenceGroup
    times: FloatArray
    truth: Trajectory
    odometry: Trajectory
    shots: tuple[_Shot, ...]
    building_key: _BuildingKey


class Simulation:
    """A configuration made ready: everything is checked and every way is known before anything is rendered.

    Parameters
    ----------
    config : SimulationConfig
    folder : Path
        Where relative paths in it start.

    Raises
    ------
    ConfigError
        Unknown scene or light, missing mesh, sun below the horizon, no room for the camera, a way that leaves the map.
    """

    def __init__(self, config: SimulationConfig, folder: Path = Path()) -> None:
        self.config = config
        scene, self._scene_folder = load_scene(config.scene, folder)
        self.scene: Scene = scene
        light_of(scene, config.references_light, "references_light")
        for order, group in enumerate(config.sequences):
            light_of(scene, group.light, f"sequences.{order}.light")
        self._buildings: dict[_BuildingKey, Building] = {}
        self._casters: dict[_BuildingKey, RayCaster] = {}
        self._recorded = (config.references_moved, config.seed) if config.references_moved > 0.0 else _AS_IT_STANDS
        building = self._building(self._recorded)
        height = config.camera.height_m or 0.0
        self.space = FreeSpace(building, height + 0.1)
        places = reference_poses(self.space)
        self.roads = RoadMap(self.space, places)
        along = config.references_drive
        self.references = places if along is None else self._frames_of(along)
        self.body = None if config.body is None else read_body(folder / config.body, config.size)
        self._sequences = [
            self._planned(group, number, order) for order, group in enumerate(config.sequences) for number in range(group.count)
        ]

    @property
    def frames(self) -> int:
        """Images to render."""
        return len(self.references) + sum(len(sequence.shots) for sequence in self._sequences)

    @property
    def said(self) -> str:
        """Everything that the data set depends on, as text: a folder that was begun with it is gone on with."""
        return json.dumps(
            {
                "config": self.config.model_dump(mode="json"),
                "scene": self.scene.model_dump(mode="json"),
                "body": None if self.body is None else hashlib.sha256(self.body.tobytes()).hexdigest(),
            },
            sort_keys=True,
        )

    def world(self, light: str, used: Backend, progress: Progress, building: _BuildingKey = _AS_IT_STANDS) -> World:
        """The scene under a light."""
        put_up = self._building(building)
        what = f"light: {light}" if building == _AS_IT_STANDS else f"light: {light}, things moved"
        return World(
            put_up,
            light,
            used,
            self.config.rendering.samples,
            lambda done, total: progress(done, total, what),
            self._caster(building, used),
            self.config.floor_gloss,
        )

    def run(self, path: Path, progress: Progress, notice: Callable[[str], None]) -> Path:
        """Render into a folder, or go on where an earlier run was stopped.

        Raises
        ------
        DatasetError, OutputError
            The folder holds something else, or cannot be written, or the disk is full.
        """
        used = backend()
        if used.remark:
            notice(used.remark)
        self._refuse_cameras_inside_things(used)
        self._claim(path)
        config = self.config
        writer = DatasetWriter(
            path, config.name, config.camera, config.description or self.scene.description, config.licence, resume=True
        )
        pictures = _Pictures(self, used, progress)
        ending = "png" if config.jpeg_quality is None else "jpg"
        height = config.camera.height_m or 0.0
        shots = tuple(
            _Shot(pose, height, (), (0.0, 0.0), False, (config.seed, 1, index))
            for index, pose in enumerate(config.camera.mounting.camera_poses(self.references))
        )
        names = [f"ref_{index:03d}.{ending}" for index in range(len(shots))]
        view = _View(config.references_light, self._recorded, config.camera, config.size)
        writer.add_references(pictures.of(path / "references", names, shots, view), self.references, names=names)
        for sequence in self._sequences:
            group = sequence.group
            view = _View(group.light, sequence.building_key, group.camera or config.camera, group.size or config.size)
            names = [f"images/f{index:03d}.{ending}" for index in range(len(sequence.shots))]
            images = pictures.of(path / "sequences" / sequence.name, names, sequence.shots, view)
            writer.add_sequence(
                sequence.name, sequence.times, images, sequence.odometry, sequence.truth, camera=view.camera, names=names
            )
        finished = writer.finish()
        (path / MARK).unlink(missing_ok=True)
        return finished

    def _refuse_cameras_inside_things(self, used: Backend) -> None:
        """What surrounds a camera and is seen from behind is the inside of something, what lies below it a ceiling or a roof."""
        groups: dict[_BuildingKey, list[tuple[str, FloatArray]]] = {}
        height = self.config.camera.height_m or 0.0
        taken = self.config.camera.mounting.camera_poses(self.references)
        at = [("reference", np.array([pose[0], pose[1], height])) for pose in taken]
        groups[self._recorded] = at
        for sequence in self._sequences:
            shots = [(f"sequence {sequence.name}", np.array([*shot.pose[:2], shot.height_m])) for shot in sequence.shots]
            groups.setdefault(sequence.building_key, []).extend(shots)
        faults = []
        angles = 2.0 * np.pi * np.arange(24) / 24
        around = np.column_stack([np.cos(angles), np.sin(angles), np.tile([-0.3, 0.0, 0.3], 8)])
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        around = np.concatenate([around, [[0.0, 0.0, -1.0]]])
        for key, cameras in groups.items():
            patches = self._building(key).patches
            points = np.repeat([point for _, point in cameras], len(around), axis=0)
            directions = np.tile(around, (len(cameras), 1))
            _, owner = self._caster(key, used).cast(points, directions)
            behind = (owner >= 0) & (np.einsum("ij,ij->i", directions, patches.normal[owner]) > 0.0)
            # Meshes of the user have no side that is surely the outer one.
            below = (behind & ~patches.triangle[owner]).reshape(len(cameras), -1)[:, -1]
            share = behind.reshape(len(cameras), -1)[:, :-1].mean(axis=1)
            for (what, (x, y, z)), inside, above in zip(cameras, share, below, strict=True):
                where = f"scene '{self.scene.name}': {what} at [{x:.2f}, {y:.2f}], {z:g} m high: the camera is"
                if inside > 0.8:
                    faults.append(f"{where} inside a thing; move the places, or the thing")
                elif above:
                    faults.append(f"{where} above a ceiling or a roof; lower camera.height_m or height_change_m")
        if faults:
            more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
            raise ConfigError(faults[0] + more)

    def _frames_of(self, along: ReferenceDrive) -> FloatArray:
        """Poses (n, 3) of the robot where references are taken on a drive."""
        rng = np.random.default_rng([self.config.seed, 4])
        since = np.arange(along.frames) * along.every_s
        return driven(along.drive, self.roads, float(since[-1]) + along.every_s, rng, "references_drive.drive").at(since)

    def _caster(self, key: _BuildingKey, used: Backend) -> RayCaster:
        if key not in self._casters:
            self._casters[key] = RayCaster(self._building(key).patches, used)
        return self._casters[key]

    def _building(self, key: _BuildingKey) -> Building:
        if key not in self._buildings:
            self._buildings[key] = build(self.scene, self._scene_folder, *key)
        return self._buildings[key]

    def _planned(self, group: SequenceGroup, number: int, order: int) -> _Sequence:
        config = self.config
        # Seeded by the name, so that leaving a sequence out does not change the others.
        name = f"{group.name}_{number:02d}"
        rng = np.random.default_rng([config.seed, 2, *name.encode()])
        since = np.round(0.1 + np.arange(group.frames) * group.every_s, 6)
        duration = float(since[-1]) + group.every_s
        where = f"sequences.{order}.drive"
        key = (group.moved, config.seed) if group.moved > 0.0 else _AS_IT_STANDS
        roads = self.roads
        if group.moved > 0.0:
            # What has been moved may stand in the way.
            moved_space = FreeSpace(self._building(key), (config.camera.height_m or 0.0) + 0.1)
            places = self.roads.places
            left = places[moved_space.distance(places) >= self.scene.clearance_m]
            roads = RoadMap(moved_space, left if len(left) else places)
        path = driven(group.drive, roads, duration, rng, where)
        period = 1.0 / config.odometry.rate_hz
        reports = np.arange(0.1 - _ODOMETRY_LEAD_S, since[-1] + 1.5 * period, period)
        odometry = reported(path, reports, config.odometry, rng)
        times = np.round(_START_S + since, 6)
        walks = [
            Walk(wander(roads, duration, Drive(speed_m_s=0.9, turn_deg_s=200.0), rng), float(rng.uniform(0.1, 0.6)))
            for _ in range(group.people)
        ]
        poses = path.at(since)
        camera = group.camera or config.camera
        height = (camera.height_m or 0.0) + group.height_change_m
        if height <= 0.02:
            raise ConfigError(
                f"sequences.{order}.height_change_m = {group.height_change_m:g}: puts the camera below the floor; raise it"
            )
        sd = math.radians(group.tilt_deg) / math.sqrt(2.0)
        tilts = rng.standard_normal((group.frames, 2)) * sd
        label = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")
        shots = tuple(
            _Shot(
                camera.mounting.camera_poses(poses[index]),
                height,
                _apart(tuple(walk.at(float(since[index])) for walk in walks), poses[index]),
                (float(tilts[index, 0]), float(tilts[index, 1])),
                group.auto_exposure,
                (config.seed, 3, label, index),
            )
            for index in range(group.frames)
        )
        return _Sequence(
            name,
            group,
            times,
            Trajectory(times, poses),
            Trajectory(np.round(_START_S + reports, 6), odometry.poses),
            shots,
            key,
        )

    def _claim(self, path: Path) -> None:
        """Make the folder ours, or make sure that it is: an earlier run with the same configuration that was stopped."""
        resumed = (path / MARK).is_file()
        if not resumed and (path / "dataset.yaml").exists():
            raise DatasetError(f"{path}: already holds a data set; choose another folder or remove it")
        if resumed:
            if (path / MARK).read_text(encoding="utf-8") != self.said:
                raise DatasetError(
                    f"{path}: holds part of a data set of another configuration; finish that one, choose another folder or remove it"
                )
        elif path.exists() and not (path.is_dir() and all(found.name.startswith(f".{MARK}.") for found in path.iterdir())):
            raise DatasetError(f"{path}: already exists and is not empty; choose another folder or remove it")
        free = shutil.disk_usage(next(folder for folder in (path, *path.absolute().parents) if folder.is_dir())).free
        if free < _LEAST_FREE_BYTES:
            raise DatasetError(f"{path}: only {free / 1e6:.0f} MB are free on the disk; make room or choose another folder")
        remove_unfinished(path)
        if not resumed:
            write_atomically(path / MARK, self.said)


class _Pictures:
    """Renders the images that are not there yet; what several need, light and rays, is kept."""

    def __init__(self, simulation: Simulation, used: Backend, progress: Progress) -> None:
        self._simulation, self._used, self._progress = simulation, used, progress
        self._worlds: dict[tuple[str, _BuildingKey], World] = {}
        self._rays: dict[tuple[str, tuple[int, int]], RayTable] = {}
        self._done = 0

    def of(self, folder: Path, names: list[str], shots: tuple[_Shot, ...], view: _View) -> Iterator[Image | None]:
        """One after the other; None for one that is there, from an earlier run or because it was written here."""
        quality = self._simulation.config.jpeg_quality
        for name, shot in zip(names, shots, strict=True):
            image: Image | None = None
            if not (folder / name).is_file():
                image = self._render(shot, view)
                if quality is not None:
                    write_image(folder / name, image, quality)
                    image = None
            yield image
            self._done += 1
            self._progress(self._done, self._simulation.frames, "frames")

    def _render(self, shot: _Shot, view: _View) -> NDArray[np.uint8]:
        where, camera = (view.light, view.building), (repr(view.camera), view.size)
        sensor = self._simulation.config.sensor
        if where not in self._worlds:
            self._worlds[where] = self._simulation.world(view.light, self._used, self._progress, view.building)
        if camera not in self._rays:
            self._rays[camera] = ray_table(view.camera, view.size, sensor.samples)
        luminance, seen = self._worlds[where].luminance(self._rays[camera], shot.pose, shot.height_m, shot.people, shot.tilt)
        if self._simulation.body is not None and view.camera == self._simulation.config.camera:
            luminance = overlaid(luminance, seen, self._simulation.body, sensor.gamma)
        # A generator a frame: a frame comes out the same whether those before it were rendered in this run or not.
        return expose(luminance, seen, sensor, np.random.default_rng(shot.key), shot.auto_exposure)


def _apart(people: tuple[Person, ...], pose: FloatArray) -> tuple[Person, ...]:
    """People step aside for the robot: nobody is shown who would stand in it."""
    return tuple(one for one in people if math.hypot(one.position[0] - pose[0], one.position[1] - pose[1]) > 0.45)
