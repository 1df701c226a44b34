"""A bare room cast ray by ray: four walls without end and a floor, all covered with smooth patterns.

What view synthesis takes the world for is exactly true in it, and every distance has a formula.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.references import ReferencePanoramas

_WAVES = 24


@dataclass(frozen=True)
class BareRoom:
    """Walls at low and high (x, y), metres; patterns are drawn from the seed, with waves no shorter than ``finest_m``."""

    low: tuple[float, float] = (-1.5, -1.2)
    high: tuple[float, float] = (3.5, 2.7)
    height_m: float = 0.6
    finest_m: float = 0.35
    seed: int = 0
    waves: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        # For each of the five surfaces: wave numbers along u and v, and phase.
        angle, phase = rng.uniform(0.0, 2.0 * np.pi, (2, 5, _WAVES))
        number = 2.0 * np.pi / rng.uniform(self.finest_m, 4.0 * self.finest_m, (5, _WAVES))
        object.__setattr__(self, "waves", np.stack([number * np.cos(angle), number * np.sin(angle), phase], axis=-1))

    def profile(self, position, columns):
        """Distance of the walls in every column at heading 0."""
        azimuth = -2.0 * np.pi * np.arange(columns) / columns
        return self._walls(np.asarray(position), np.cos(azimuth), np.sin(azimuth))[0]

    def _walls(self, position, dx, dy):
        # A ray along a wall must not divide by zero.
        dx, dy = (np.where(np.abs(part) < 1e-12, 1e-12, part) for part in (dx, dy))
        x = np.where(dx > 0.0, self.high[0] - position[0], self.low[0] - position[0]) / dx
        y = np.where(dy > 0.0, self.high[1] - position[1], self.low[1] - position[1]) / dy
        wall = np.where(x < y, np.where(dx > 0.0, 1, 0), np.where(dy > 0.0, 3, 2))
        return np.minimum(x, y), wall

    def panorama(self, geometry, pose, tilt=(0.0, 0.0), *, samples=3):
        """What a camera sees at a pose (x, y, heading).

        ``tilt`` is the camera's rotation vector about the robot's axes to the left (nose down) and ahead (right side down), radians.
        """
        rows, columns = geometry.shape
        c = (np.arange(columns * samples) + 0.5) / samples - 0.5
        r = (np.arange(rows * samples) + 0.5) / samples - 0.5
        azimuth, elevation = np.meshgrid(geometry.azimuth_of_column(c), geometry.elevation_of_row(r))
        ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        turn = Rotation.from_euler("z", pose[2]) * Rotation.from_rotvec([tilt[1], tilt[0], 0.0])
        ray = np.einsum("ij,jrc->irc", turn.as_matrix(), ray)
        level = np.hypot(ray[0], ray[1])
        distance, surface = self._walls(np.asarray(pose[:2]), ray[0] / level, ray[1] / level)
        slope = ray[2] / level
        floor = np.where(slope < 0.0, -self.height_m / np.minimum(slope, -1e-12), np.inf)
        surface = np.where(floor < distance, 4, surface)
        distance = np.minimum(floor, distance)
        x, y = (pose[axis] + distance * ray[axis] / level for axis in (0, 1))
        z = self.height_m + distance * slope
        u = np.where(surface < 2, y, x)
        v = np.where(surface == 4, y, z)
        grey = np.zeros(u.shape)
        for index, waves in enumerate(self.waves):
            here = surface == index
            grey[here] = np.cos(u[here][:, None] * waves[:, 0] + v[here][:, None] * waves[:, 1] + waves[:, 2]).sum(axis=1)
        grey = 128.0 + 80.0 * np.tanh(grey / np.sqrt(_WAVES))
        mean = grey.reshape(rows, samples, columns, samples).mean(axis=(1, 3))
        return Panorama(np.rint(mean).astype(np.float32))

    def references(self, geometry: PanoramaGeometry, positions) -> ReferencePanoramas:
        positions = np.asarray(positions, dtype=np.float64)
        return ReferencePanoramas(
            pixels=np.stack([self.panorama(geometry, (x, y, 0.0)).pixels.astype(np.uint8) for x, y in positions]),
            valid=None,
            positions=positions,
            names=tuple(f"ref_{index}.png" for index in range(len(positions))),
            geometry=geometry,
            camera_height_m=self.height_m,
        )

    def profiles(self, positions, columns):
        """Of several places, (n, columns)."""
        return np.stack([self.profile(position, columns) for position in positions])
