"""What Mitsuba is for: carries light through a scene, and finds what rays hit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.engine.backend import Backend, mesh, opaque
from panoloc_mcl.laboratory.simulation.patches import Patches
from panoloc_mcl.laboratory.simulation.scene import Light, Site
from panoloc_mcl.laboratory.simulation.sun import sun_direction

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Lumen a watt, and what Mitsuba divides by when it turns spectra into colours: luminance in cd/m2 of a colour's Y.
_LUMEN = 683.0 * 106.856895
_LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
_LIFT_M = 1e-3
_DEPTH = 10
_PASSES = 8
_RAYS_AT_ONCE = 1_000_000


class RayCaster:
    """Finds the first surface along rays.

    Parameters
    ----------
    patches : Patches
    used : Backend
    """

    def __init__(self, patches: Patches, used: Backend) -> None:
        self._used, self._patches = used, patches
        vertices, faces, self._owner = patches.triangles()
        self._scene = used.mi.load_dict({"type": "scene", "all": mesh(used.mi, "all", vertices, faces)})

    def cast(self, origin: FloatArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
        """Distance (m; infinite for none) and surface (-1 for none) of the first hit of every ray.

        Parameters
        ----------
        origin : ndarray of float64, shape (3,) or (n, 3)
        directions : ndarray of float64, shape (n, 3)
        """
        mi = self._used.mi
        if self._used.vectorised:
            o = (
                [opaque(mi.Float, float(value)) for value in origin]
                if origin.ndim == 1
                else [mi.Float(np.ascontiguousarray(column, dtype=np.float32)) for column in origin.T]
            )
            d = [mi.Float(np.ascontiguousarray(column, dtype=np.float32)) for column in directions.T]
            found = self._scene.ray_intersect_preliminary(mi.Ray3f(mi.Point3f(*o), mi.Vector3f(*d)), coherent=True)
            distance = np.array(found.t, dtype=np.float64)
            face = np.array(found.prim_index, dtype=np.int64)
        else:
            distance, face = np.full(len(directions), np.inf), np.zeros(len(directions), dtype=np.int64)
            each = np.broadcast_to(origin, directions.shape).tolist()
            for index, (o, d) in enumerate(zip(each, directions.tolist(), strict=True)):
                hit = self._scene.ray_intersect_preliminary(mi.Ray3f(o, d))
                if hit.is_valid():
                    distance[index], face[index] = hit.t, hit.prim_index
        missed = ~np.isfinite(distance)
        return distance, np.where(missed, -1, self._owner[np.where(missed, 0, face)])


@dataclass(frozen=True, eq=False)
class Sources:
    """What shines, in photometric units.

    Parameters
    ----------
    luminance : ndarray of float64, shape (sources,)
        Of panes and lamps, cd/m2.
    window_transmittance : float
    sky : ndarray of float64, shape (rows, columns)
        Luminance of the sky through the windows, without the sun: rows from zenith to nadir, columns counter-clockwise from x.
    outdoor_lux : float
        On level ground outside.
    """

    luminance: FloatArray
    window_transmittance: float
    sky: FloatArray
    outdoor_lux: float


class Daylight:
    """A light of the day: turned into what Mitsuba shines with.

    Parameters
    ----------
    site : Site
    light : Light
    """

    def __init__(self, site: Site, light: Light) -> None:
        self.site, self.light = site, light
        self.direction = sun_direction(site, light.time_h)

    def emitter(self, transmittance: float, sun: bool = True) -> dict[str, Any] | None:
        """Mitsuba's sun and sky in lumen instead of watts, dimmed by a transmittance; None when it is dark."""
        scale = _LUMEN * transmittance
        sun_scale, sky_scale = (self.light.sun if sun else 0.0) * scale, self.light.sky * scale
        if sun_scale == 0.0 and sky_scale == 0.0:
            return None
        return {
            "type": "sunsky",
            "sun_direction": [float(value) for value in self.direction],
            "turbidity": float(self.light.turbidity),
            "albedo": float(self.site.ground_albedo),
            "sun_scale": float(sun_scale),
            "sky_scale": float(sky_scale),
        }


def sources_of(patches: Patches, site: Site, light: Light, window_transmittance: float, used: Backend) -> Sources:
    """How strongly the panes, the lamps and the sky shine; panes are lit by sun and sky, without shadows, from outside."""
    daylight = Daylight(site, light)
    normals = np.array([[0.0, 0.0, 1.0]])
    owner = [int(np.flatnonzero(patches.source == index)[0]) for index in range(len(patches.sources))]
    if owner:
        normals = np.concatenate([normals, -patches.normal[owner]])
    arriving = _outdoors(daylight, normals, site.ground_albedo, used)
    luminance = np.zeros(len(patches.sources))
    for index, (_, kind, strength) in enumerate(patches.sources):
        luminance[index] = arriving[1 + index] * strength / np.pi if kind == "pane" else strength * light.lamps
    sky = _sky_table(daylight, window_transmittance, used)
    return Sources(luminance, window_transmittance, sky, float(arriving[0]))


def _outdoors(daylight: Daylight, normals: FloatArray, ground: float, used: Backend) -> FloatArray:
    """Illuminance, lux, of surfaces that look along normals (n, 3), above open ground."""
    emitter = daylight.emitter(1.0)
    if emitter is None:
        return np.zeros(len(normals))
    mi = used.mi
    places = np.array([(20.0 * index, 0.0, 8.0) for index in range(len(normals))])
    sides = [np.cross(n, (1.0, 0.0, 0.0) if abs(n[0]) < 0.9 else (0.0, 1.0, 0.0)) for n in normals]
    vertices = np.concatenate(
        [p + 0.1 * np.array([a, np.cross(n, a), -a - np.cross(n, a)]) for p, n, a in zip(places, normals, sides, strict=True)]
    )
    faces = np.arange(len(vertices)).reshape(-1, 3)
    far = np.array([[-1e4, -1e4, 0.0], [1e4, -1e4, 0.0], [1e4, 1e4, 0.0], [-1e4, 1e4, 0.0]])
    scene = mi.load_dict(
        {
            "type": "scene",
            "sky": emitter,
            "meters": mesh(mi, "meters", vertices, faces, np.full(len(faces), 0.5)),
            "ground": mesh(mi, "ground", far, np.array([[0, 1, 2], [0, 2, 3]]), np.full(2, ground)),
        }
    )
    return _illuminance(scene, places, normals, np.full(len(normals), 0.5), 16384, 3, used)


def _sky_table(daylight: Daylight, transmittance: float, used: Backend) -> FloatArray:
    rows, columns = 90, 360
    emitter = daylight.emitter(transmittance, sun=False)
    if emitter is None:
        return np.zeros((rows, columns))
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    azimuth = 2.0 * np.pi * (np.arange(columns) + 0.5) / columns
    p, a = (grid.ravel() for grid in np.meshgrid(polar, azimuth, indexing="ij"))
    towards = np.column_stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)])
    scene = used.mi.load_dict({"type": "scene", "sky": emitter})
    radiance = _radiance(scene, np.zeros_like(towards), towards, 1, 0, used, depth=2)
    return np.maximum(radiance, 0.0).reshape(rows, columns)


class LightTransport:
    """Illuminance on surfaces of a lit scene, by Mitsuba's path tracer.

    Surfaces are matt, and reflect with the mean albedo of their pictures. What lies outside is seen, and shines in, through
    the windows only, and is therefore dimmed by their glass as a whole.

    Parameters
    ----------
    patches : Patches
    sources : Sources
    daylight : Daylight
    used : Backend
    """

    def __init__(self, patches: Patches, sources: Sources, daylight: Daylight, used: Backend) -> None:
        self._patches, self._used = patches, used
        mi = used.mi
        vertices, faces, owner = patches.triangles()
        parts: dict[str, Any] = {"type": "scene"}
        matt = patches.source[owner] < 0
        parts["matt"] = mesh(mi, "matt", vertices, faces[matt], patches.mean_albedo[owner[matt]])
        for index, luminance in enumerate(sources.luminance):
            chosen = patches.source[owner] == index
            parts[f"source_{index}"] = mesh(
                mi, f"source_{index}", vertices, faces[chosen], patches.mean_albedo[owner[chosen]], float(luminance)
            )
        emitter = daylight.emitter(sources.window_transmittance)
        if emitter is not None:
            parts["sky"] = emitter
        self._scene = mi.load_dict(parts)

    def light_map(self, samples: int, seed: int, progress: Callable[[int, int], None]) -> NDArray[np.float32]:
        """Illuminance, lux, of every cell of the patches' light maps, shape (cells,)."""
        patches = self._patches
        direct, squared, whole = np.zeros(patches.cells), np.zeros(patches.cells), np.zeros(patches.cells)
        rng = np.random.default_rng([seed, 31])
        each = max(1, samples // _PASSES)
        for step in range(_PASSES):
            points, owner = patches.cell_points(rng.uniform(0.02, 0.98, (patches.cells, 2)))
            where = points, patches.normal[owner], patches.mean_albedo[owner]
            # The same random numbers for both: they share the direct light to the last bit.
            whole += _illuminance(self._scene, *where, each, seed + step, self._used)
            straight = _illuminance(self._scene, *where, each, seed + step, self._used, depth=2)
            direct += straight
            squared += straight**2
            progress(step + 1, _PASSES)
        own = patches.source[owner] >= 0
        indirect = patches.smoothed((whole - direct) / _PASSES)
        direct /= _PASSES
        variance = np.maximum(squared / _PASSES - direct**2, 0.0) / (_PASSES - 1)
        return np.where(own, 0.0, np.maximum(patches.denoised(direct, variance) + indirect, 0.0)).astype(np.float32)

    def meter(self, points: FloatArray, normals: FloatArray, samples: int, seed: int) -> FloatArray:
        """Illuminance, lux, at points in the open (n, 3) on a plane that looks along normals (n, 3); by gathering light.

        A point in the air has no surface to reflect: what arrives is summed over directions drawn by the cosine law, and
        light sources that are hit count, too.
        """
        rng = np.random.default_rng([seed, 32])
        n = len(points)
        grid = int(np.ceil(np.sqrt(samples)))
        total = np.zeros(n)
        a = np.cross(normals, np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]]))
        a /= np.linalg.norm(a, axis=1, keepdims=True)
        b = np.cross(normals, a)
        for row in range(grid):
            # Stratified in both dimensions.
            u = (row + rng.uniform(size=(n, grid))) / grid
            v = (np.arange(grid) + rng.uniform(size=(n, grid))) / grid
            radius, angle = np.sqrt(u), 2.0 * np.pi * v
            d = (
                (radius * np.cos(angle))[..., None] * a[:, None]
                + (radius * np.sin(angle))[..., None] * b[:, None]
                + np.sqrt(1.0 - u)[..., None] * normals[:, None]
            ).reshape(-1, 3)
            o = np.repeat(points, grid, axis=0)
            total += _radiance(self._scene, o, d, 1, seed + row, self._used).reshape(n, grid).sum(axis=1)
        return np.pi * total / grid**2


def _illuminance(
    scene: Any,
    points: FloatArray,
    normals: FloatArray,
    albedo: FloatArray,
    samples: int,
    seed: int,
    used: Backend,
    depth: int = _DEPTH,
) -> FloatArray:
    # What a matt surface of known albedo sends back straight ahead tells what falls on it.
    leaving = _radiance(scene, points + _LIFT_M * normals, -normals, samples, seed, used, depth)
    return np.asarray(np.pi * leaving / albedo)


def _radiance(
    scene: Any, origins: FloatArray, directions: FloatArray, samples: int, seed: int, used: Backend, depth: int = _DEPTH
) -> FloatArray:
    """Mean radiance of paths that begin with the given rays (n, 3)."""
    mi = used.mi
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": 6})
    sampler = mi.load_dict({"type": "independent"})
    result = np.zeros(len(origins))
    chunk = max(1, _RAYS_AT_ONCE // samples)
    for number, start in enumerate(range(0, len(origins), chunk)):
        o, d = origins[start : start + chunk], directions[start : start + chunk]
        if used.vectorised:
            # One ray after the other, all samples of the first one first.
            ray = mi.RayDifferential3f(
                mi.Point3f(*(mi.Float(np.repeat(column, samples).astype(np.float32)) for column in o.T)),
                mi.Vector3f(*(mi.Float(np.repeat(column, samples).astype(np.float32)) for column in d.T)),
            )
            sampler.seed(opaque(mi.UInt32, seed * 7919 + number), len(o) * samples)
            colour = np.array(integrator.sample(scene, sampler, ray)[0], dtype=np.float64)
            result[start : start + len(o)] = (_LUMINANCE @ colour).reshape(len(o), samples).mean(axis=1)
        else:
            sampler.seed(seed * 7919 + number)
            for index, (origin, direction) in enumerate(zip(o.tolist(), d.tolist(), strict=True)):
                ray = mi.RayDifferential3f(mi.Ray3f(origin, direction))
                total = 0.0
                for _ in range(samples):
                    r, g, b = integrator.sample(scene, sampler, ray)[0]
                    total += _LUMINANCE[0] * r + _LUMINANCE[1] * g + _LUMINANCE[2] * b
                result[start + index] = total / samples
    return result
