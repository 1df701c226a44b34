"""A scene under one light, ready to be looked at: light maps are made once, a frame is rays and look-ups."""

from __future__ import annotations

import hashlib
import json
import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.building import Building
from panoloc_mcl.laboratory.simulation.engine.backend import Backend
from panoloc_mcl.laboratory.simulation.optics import RayTable, tilted
from panoloc_mcl.laboratory.simulation.patches import look_up
from panoloc_mcl.laboratory.simulation.people import Person, hit_people
from panoloc_mcl.laboratory.simulation.renderer import Daylight, LightTransport, RayCaster, Sources, sources_of
from panoloc_mcl.laboratory.simulation.sun import light_of
from panoloc_mcl.robot.errors import OutputError
from panoloc_mcl.robot.files import cache_folder, read_arrays, write_arrays
from panoloc_mcl.robot.source import source_digest

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# What light maps are computed by.
_LIGHT = tuple(f"laboratory/simulation/{name}.py" for name in ("patches", "renderer", "sun"))
_PROBE_M = 1.1  # height at which the light on people is measured
_PROBE_STEP_M = 1.5
_AXES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
_RAYS_AT_ONCE = 500_000
_A_PERSON = -2  # instead of a surface
# Floors that may mirror: their normals point so much up, and they lie so near to height 0.
_LEVEL, _FLOOR_M = 0.99, 1e-3
_VARNISH = 0.04


class World:
    """A building under one light.

    Parameters
    ----------
    building : Building
    light : str
        Name of one of the scene's lights.
    used : Backend
    samples : int
        Light paths from each cell of the light maps.
    progress : callable
        Called with (done, total) while light is carried.
    caster : RayCaster, optional
        Of the same building, if there is one already.
    floor_gloss : float
        Share of what a varnished floor mirrors that floors at height 0 do.

    Raises
    ------
    ConfigError
        A light that is none, or that the scene does not have.
    """

    def __init__(
        self,
        building: Building,
        light: str,
        used: Backend,
        samples: int,
        progress: Callable[[int, int], None],
        caster: RayCaster | None = None,
        floor_gloss: float = 0.0,
    ) -> None:
        self.building, self.light, self._floor_gloss = building, light, floor_gloss
        scene, patches = building.scene, building.patches
        chosen = light_of(scene, light)
        self._used, self._daylight = used, Daylight(scene.site, chosen)
        self.caster = caster if caster is not None else RayCaster(patches, used)
        self._probe_corner, self._probe_shape = _probe_grid(building)
        path = cache_folder() / "light" / f"{self._key(samples)}.npz"
        arrays = _cached(path)
        if arrays is None:
            self.sources = sources_of(patches, scene.site, chosen, scene.window_transmittance, used)
            transport = LightTransport(patches, self.sources, self._daylight, used)
            lux = transport.light_map(samples, 1, progress)
            self._probes = self._measure_probes(transport)
            arrays = {
                "lux": lux,
                "probes": self._probes,
                "luminance": self.sources.luminance,
                "sky": self.sources.sky,
                "outdoor": np.array([self.sources.outdoor_lux]),
            }
            try:
                write_arrays(path, {"light": light, "scene": scene.name}, arrays)
            except OutputError as error:
                warnings.warn(f"light not kept for the next run: {error}", RuntimeWarning, stacklevel=2)
        self.sources = Sources(arrays["luminance"], scene.window_transmittance, arrays["sky"], float(arrays["outdoor"][0]))
        self._lux, self._probes = arrays["lux"], arrays["probes"]

    def luminance(
        self,
        rays: RayTable,
        pose: FloatArray,
        height_m: float,
        people: tuple[Person, ...] = (),
        tilt: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """What the camera sees, cd/m2, and which pixels it sees at all; both (height, width).

        Parameters
        ----------
        rays : RayTable
        pose : array_like of float, shape (3,)
        height_m : float
        people : tuple of Person
        tilt : (float, float)
            Pitch and roll, radians.
        """
        origin = np.array([pose[0], pose[1], height_m])
        c, s = math.cos(pose[2]), math.sin(pose[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        each = np.empty(len(rays.directions))
        for start in range(0, len(each), _RAYS_AT_ONCE):
            part = slice(start, start + _RAYS_AT_ONCE)
            directions = tilted(rays.directions[part], *tilt) @ turn.T
            each[part] = self._along(origin, directions, people)
        width, height = rays.size
        image = np.zeros(width * height)
        # A sensor saturates as a whole pixel, so the mean of the light is what counts.
        image[rays.pixel] = each.reshape(-1, rays.samples).mean(axis=1)
        seen = np.zeros(width * height, dtype=bool)
        seen[rays.pixel] = True
        return image.reshape(height, width), seen.reshape(height, width)

    def _along(
        self, origin: FloatArray, directions: FloatArray, people: tuple[Person, ...], start: FloatArray | None = None
    ) -> FloatArray:
        """Light along rays; ``start``: they were mirrored so far from the origin, which lies below the floor."""
        patches = self.building.patches
        if start is None:
            distance, owner = self.caster.cast(origin, directions)
        else:
            distance, owner = self.caster.cast(origin + start[:, None] * directions, directions)
            distance = distance + start
        result = np.zeros(len(directions))
        hit = np.flatnonzero(owner >= 0)
        of, points = owner[hit], origin + distance[hit, None] * directions[hit]
        s, t = patches.coordinates(points, of)
        albedo = look_up(patches.texels, patches.texture_at, of, s, t)
        lux = look_up(self._lux, patches.cells_at, of, s, t)
        shining = (
            np.where(patches.source[of] >= 0, self.sources.luminance[patches.source[of]], 0.0)
            if len(self.sources.luminance)
            else 0.0
        )
        front = np.einsum("ij,ij->i", directions[hit], patches.normal[of]) < 0.0
        result[hit] = np.where(front | patches.triangle[of], albedo * lux / np.pi + shining, 0.0)
        missed = np.flatnonzero(owner < 0)
        result[missed] = self._sky(directions[missed])
        for person in people:
            nearer, near, normals, shade = hit_people(person, origin, directions, distance)
            light = self._light_on_people(person.position, normals)
            result[nearer] = shade * light / np.pi
            distance[nearer] = near
            owner[nearer] = _A_PERSON
        if self._floor_gloss > 0.0 and start is None:
            self._mirror(origin, directions, people, distance, owner, result)
        return result

    def _mirror(
        self,
        origin: FloatArray,
        directions: FloatArray,
        people: tuple[Person, ...],
        distance: FloatArray,
        owner: IntArray,
        result: FloatArray,
    ) -> None:
        """Add what glossy floors mirror: what a camera as far below the floor would see through it."""
        level = (owner >= 0) & (self.building.patches.normal[owner, 2] > _LEVEL) & (directions[:, 2] < 0.0)
        floor = np.flatnonzero(level)
        floor = floor[np.abs(origin[2] + distance[floor] * directions[floor, 2]) < _FLOOR_M]
        over = np.array([1.0, 1.0, -1.0])
        seen = self._along(origin * over, directions[floor] * over, people, distance[floor] + _FLOOR_M)
        result[floor] += self._floor_gloss * mirrored_share(-directions[floor, 2]) * seen

    def _sky(self, directions: FloatArray) -> FloatArray:
        rows, columns = self.sources.sky.shape
        row = np.clip(np.arccos(np.clip(directions[:, 2], -1.0, 1.0)) / np.pi * rows, 0, rows - 1).astype(np.int64)
        column = (np.mod(np.arctan2(directions[:, 1], directions[:, 0]), 2.0 * np.pi) / (2.0 * np.pi) * columns).astype(
            np.int64
        )
        return np.asarray(self.sources.sky[row, np.minimum(column, columns - 1)])

    def _measure_probes(self, transport: LightTransport) -> FloatArray:
        rows, columns = self._probe_shape
        y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
        grid = np.column_stack([x.ravel(), y.ravel()]) * _PROBE_STEP_M + self._probe_corner
        points = np.asarray(np.column_stack([grid, np.full(len(grid), _PROBE_M)]), dtype=np.float64)
        six = [transport.meter(points, np.ones((len(points), 1)) * axis, 256, 40 + k) for k, axis in enumerate(_AXES)]
        return np.stack(six, axis=-1).reshape(rows, columns, 6)

    def _light_on_people(self, position: tuple[float, float], normals: FloatArray) -> FloatArray:
        """Illuminance for normals (n, 3) from the six that were measured nearest to a person."""
        at = np.round((np.array(position) - self._probe_corner) / _PROBE_STEP_M).astype(int)
        column, row = np.clip(at, 0, np.array(self._probe_shape[::-1]) - 1)
        six = self._probes[row, column]
        square = normals * normals
        return np.asarray(
            square[:, 0] * np.where(normals[:, 0] > 0, six[0], six[1])
            + square[:, 1] * np.where(normals[:, 1] > 0, six[2], six[3])
            + square[:, 2] * np.where(normals[:, 2] > 0, six[4], six[5])
        )

    def _key(self, samples: int) -> str:
        scene, patches = self.building.scene, self.building.patches
        said = {
            "code": source_digest(_LIGHT),
            "probes": (_PROBE_M, _PROBE_STEP_M),
            "site": scene.site.model_dump(mode="json"),
            "windows": scene.window_transmittance,
            "light": scene.lights[self.light].model_dump(mode="json"),
            "sources": patches.sources,
            "samples": samples,
            "drive": scene.drive,
            "renderer": (self._used.variant, self._used.mi.__version__),
        }
        digest = hashlib.sha256(json.dumps(said, sort_keys=True).encode())
        for array in (patches.origin, patches.along, patches.across, patches.mean_albedo, patches.cells_at, patches.source):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()[:24]


def illuminance(
    building: Building, light: str, points: FloatArray, used: Backend, samples: int = 4096
) -> tuple[FloatArray, float]:
    """A lux meter that looks up, at points (n, 3): lux, shape (n,); and what it says outside.

    Parameters
    ----------
    building : Building
    light : str
    points : ndarray of float64, shape (n, 3)
    used : Backend
    samples : int
        Light paths to each point.

    Raises
    ------
    ConfigError
        A light that is none, or that the scene does not have.
    """
    scene = building.scene
    chosen = light_of(scene, light)
    sources = sources_of(building.patches, scene.site, chosen, scene.window_transmittance, used)
    transport = LightTransport(building.patches, sources, Daylight(scene.site, chosen), used)
    return transport.meter(points, np.tile(_AXES[4], (len(points), 1)), samples, 3), sources.outdoor_lux


def mirrored_share(down: FloatArray) -> FloatArray:
    """Reflectance of varnish (Schlick, 1994) by the sine of the angle between the ray and the floor."""
    return np.asarray(_VARNISH + (1.0 - _VARNISH) * (1.0 - down) ** 5)


def _probe_grid(building: Building) -> tuple[FloatArray, tuple[int, int]]:
    areas = np.array(building.scene.drive)
    low, high = areas[:, :2].min(axis=0), areas[:, 2:].max(axis=0)
    count = np.ceil((high - low) / _PROBE_STEP_M).astype(int) + 1
    return low, (int(count[1]), int(count[0]))


def _cached(path: Path) -> dict[str, NDArray[Any]] | None:
    try:
        return read_arrays(path)[1]
    except (OSError, ValueError):
        return None
