"""How a camera sits on its robot, and what is believed of it: tilt, offset, centre of the mirror, elevations, height."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from panoloc_mcl.laboratory.corruptions.draft import Draft, Float32, Float64, View, moved
from panoloc_mcl.laboratory.corruptions.sight import Sight
from panoloc_mcl.robot.camera import Mount
from panoloc_mcl.robot.camera.spec import AnyCamera, OmniCamera, PanoramaCamera
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.geometry import compose, inverse
from panoloc_mcl.robot.settings.validation import StrictModel
from panoloc_mcl.tools.calibration.parameters import with_focal_scale

Metres = Annotated[float, Field(ge=-5.0, le=5.0)]
Degrees = Annotated[float, Field(ge=-180.0, le=180.0)]
SmallAngle = Annotated[float, Field(ge=-45.0, le=45.0)]
Where = Literal["both", "references", "drives"]

# The rings that panoramas are supposed to have been unwrapped from, pixels.
_RING_PX = (28.0, 237.0)


class Tilt(StrictModel):
    """A camera mounted askew: every ray is turned, exactly. Rows that come in from beyond the image repeat its rim.

    ``degrees`` towards ``towards_deg`` (0: nose down; 90: left side down) in all images, and ``sway_deg`` rms more in each, in a
    direction of its own, as on a rough floor.
    """

    degrees: SmallAngle
    towards_deg: Degrees = 40.0
    sway_deg: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0

    def __call__(self, light: Float32, view: View) -> Float32:
        """Light as the tilted camera sees it."""
        sway = view.rng.normal(0.0, self.sway_deg / math.sqrt(2.0), 2)
        azimuth, elevation = turned(view.sight, *(self._pitch_roll + sway))
        return view.sight.sample(light, azimuth, elevation).reshape(light.shape)

    @property
    def _pitch_roll(self) -> Float64:
        towards = math.radians(self.towards_deg)
        return self.degrees * np.array([math.cos(towards), -math.sin(towards)])

    def tell(self, draft: Draft) -> None:
        """Say how the camera is mounted; how it sways nobody knows."""
        pitch, roll = self._pitch_roll
        turn = Rotation.from_rotvec([roll, pitch, 0.0], degrees=True)
        for folder in draft.folders:
            before = folder.camera.mounting
            # Seen from the base, the camera is turned about the vertical after it has been tilted.
            yaw, pitch, roll = (Rotation.from_euler("z", before.yaw_deg, degrees=True) * turn).as_euler("ZYX", degrees=True)
            angles = {"yaw_deg": float(yaw), "pitch_deg": float(pitch), "roll_deg": float(roll)}
            folder.camera = folder.camera.model_copy(update={"mount": before.model_copy(update=angles)})


def turned(sight: Sight, pitch_deg: float, roll_deg: float) -> tuple[Float64, Float64]:
    """Azimuth and elevation, in the robot's frame, of what the pixels of a tilted camera look at.

    Parameters
    ----------
    sight : Sight
        Of the camera without tilt.
    pitch_deg, roll_deg : float
        Rotation vector about the robot's y axis (positive: nose down) and x axis (positive: right side down), degrees.
    """
    a, e = sight.azimuth, sight.elevation
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)
    turns = Rotation.from_rotvec([roll_deg, pitch_deg, 0.0], degrees=True)
    x, y, z = turns.apply(rays.reshape(-1, 3)).reshape(rays.shape).transpose(2, 0, 1)
    return np.arctan2(y, x), np.arcsin(np.clip(z, -1.0, 1.0))


class Mounting(StrictModel):
    """The camera is not the robot's centre, and does not look ahead: where it sits on the base.

    Images stay what they are; all poses, those of the references, odometry and ground truth, become the base's.
    """

    x_m: Metres
    y_m: Metres = 0.0
    yaw_deg: Degrees = 0.0

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Turn the camera's poses into the base's."""
        if any(folder.camera.mount is not None for folder in draft.folders):
            raise ConfigError("mount: the camera of this data set has a mount; give that another value instead")
        back = inverse(np.array([self.x_m, self.y_m, math.radians(self.yaw_deg)]))
        draft.references.claimed = compose(draft.references.claimed, back)
        for drive in draft.drives.values():
            drive.odometry = moved(drive.odometry, lambda poses: compose(poses, back))
            drive.groundtruth = moved(drive.groundtruth, lambda poses: compose(poses, back))

    def tell(self, draft: Draft) -> None:
        """Say where the camera sits."""
        mount = Mount(x_m=self.x_m, y_m=self.y_m, yaw_deg=self.yaw_deg)
        for folder in draft.folders:
            folder.camera = folder.camera.model_copy(update={"mount": mount})


class Centre(StrictModel):
    """The centre of the mirror is off by ``pixels`` in raw images whose ring reaches 237 pixels, in the direction ``towards_deg``.

    Panoramas come out as they would from such images (radius linear in elevation); of a raw camera the centre is claimed wrong.
    """

    pixels: Annotated[float, Field(ge=0.0, le=20.0)]
    towards_deg: Degrees = 30.0
    where: Where = "drives"

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Warp panoramas, or claim another centre."""
        off = self.pixels * np.array([math.cos(math.radians(self.towards_deg)), math.sin(math.radians(self.towards_deg))])
        for folder in draft.of(self.where):
            if isinstance(folder.optics, PanoramaCamera):
                folder.disturbances.append(("centre", self))
            elif isinstance(folder.camera, OmniCamera):
                u, v = folder.camera.center_px
                scale = folder.camera.valid_radius_px[1] / _RING_PX[1]
                center = (u + scale * float(off[0]), v - scale * float(off[1]))
                folder.camera = folder.camera.model_copy(update={"center_px": center})
            else:
                raise ConfigError(
                    f"centre: is for panoramas and mirrors; camera.kind = {folder.camera.kind} has no such centre"
                )

    def __call__(self, light: Float32, view: View) -> Float32:
        """The panorama that is unwrapped around the wrong centre."""
        low, high = view.sight.field
        inner, outer = _RING_PX
        radius = inner + (view.sight.elevation - low) * ((outer - inner) / (high - low))
        towards = math.radians(self.towards_deg)
        x = radius * np.cos(view.sight.azimuth) + self.pixels * math.cos(towards)
        y = radius * np.sin(view.sight.azimuth) + self.pixels * math.sin(towards)
        elevation = low + (np.hypot(x, y) - inner) * ((high - low) / (outer - inner))
        return view.sight.sample(light, np.arctan2(y, x), elevation).reshape(light.shape)


class Focal(StrictModel):
    """The focal length of a raw camera is claimed ``scale`` times too long."""

    scale: Annotated[float, Field(gt=0.5, le=2.0)]

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Claim another focal length."""
        for folder in draft.folders:
            if isinstance(folder.camera, OmniCamera):
                folder.camera = with_focal_scale(folder.camera, self.scale)
        if not any(isinstance(folder.camera, OmniCamera) for folder in draft.folders):
            raise ConfigError("focal: is for raw mirror and fisheye images; of a panorama use elevation_scale")


class Elevation(StrictModel):
    """Elevations are claimed to be ``scale`` times what they are, about the horizon, and ``shift_deg`` higher."""

    scale: Annotated[float, Field(gt=0.1, le=10.0)] = 1.0
    shift_deg: SmallAngle = 0.0
    where: Where = "drives"

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Claim other elevations."""
        for folder in draft.of(self.where):
            folder.camera = self._claimed(folder.camera)

    def _claimed(self, camera: AnyCamera) -> AnyCamera:
        if not isinstance(camera, PanoramaCamera):
            raise ConfigError("elevation: is for panoramas; of a raw camera use centre, or change its profile")
        bottom, top = (float(np.clip(self.scale * e + self.shift_deg, -90.0, 90.0)) for e in camera.elevation_deg)
        return camera.model_copy(update={"elevation_deg": (bottom, top)})


class Height(StrictModel):
    """The height of the camera above the floor is claimed ``metres`` too large."""

    metres: Metres

    def change(self, draft: Draft, rng: np.random.Generator) -> None:
        """Claim another height."""
        for folder in draft.folders:
            folder.camera = self._claimed(folder.camera)

    def _claimed(self, camera: AnyCamera) -> AnyCamera:
        if camera.height_m is None:
            return camera
        height = camera.height_m + self.metres
        if height <= 0.0:
            raise ConfigError(
                f"height: metres = {self.metres:g}: puts the camera of {camera.height_m:g} m below the floor; raise it"
            )
        return camera.model_copy(update={"height_m": height})
