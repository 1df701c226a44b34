"""What real recordings have and rendered ones have not, by name, each mild and strong: the catalogue.

Levels are those at which such recordings are met: mild is a careful set-up with good parts, strong a hasty one with cheap parts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np

from panoloc_mcl.laboratory.corruptions import lens, mounting, scenery, surveys
from panoloc_mcl.laboratory.corruptions.draft import Disturbance, Draft
from panoloc_mcl.robot.settings.validation import StrictModel

#: The levels that every imperfection has.
LEVELS = ("mild", "strong")


class _Change(Protocol):
    def change(self, draft: Draft, rng: np.random.Generator) -> None: ...


@dataclass(frozen=True)
class Imperfection:
    """One thing that real recordings have.

    Parameters
    ----------
    settings : type
        Its parameters; what it does is in its methods: ``change`` a draft, or else be called with the light of every image.
    mild, strong : mapping
        Values of the parameters at these levels.
    calibrated : bool
        It is an error of the camera's description: whoever knows of it has mended it.
    where : str
        Which images are disturbed, unless a recipe says otherwise: ``both``, ``references`` or ``drives``.
    together : bool
        Whether it is part of ``everything``.
    """

    settings: type[StrictModel]
    mild: Mapping[str, Any]
    strong: Mapping[str, Any]
    where: str = "both"
    together: bool = True
    calibrated: bool = False

    @property
    def changes_data(self) -> bool:
        """Whether it changes what is claimed of images; otherwise images themselves."""
        return hasattr(self.settings, "change")

    def at(self, level: str) -> dict[str, Any]:
        """Values of the parameters at a level."""
        return dict(self.mild if level == "mild" else self.strong)


#: All of them, in the order in which they come about: surveys, then what light meets on its way, then what is claimed of the camera.
IMPERFECTIONS: dict[str, Imperfection] = {
    "along_drive": Imperfection(surveys.AlongDrive, {"unevenness": 0.0}, {"unevenness": 1.2}, together=False),
    "doubled": Imperfection(surveys.Doubled, {"share": 0.25}, {"share": 1.0, "apart_m": 0.02}, together=False),
    "standing": Imperfection(surveys.Standing, {"stops": 3, "images": 5}, {"stops": 8, "images": 20}, together=False),
    "turned": Imperfection(surveys.Turned, {"spread_deg": 20.0}, {"spread_deg": 360.0}, together=False),
    "mount": Imperfection(mounting.Mounting, {"x_m": 0.05}, {"x_m": 0.15}),
    "mount_yaw": Imperfection(
        mounting.Mounting, {"x_m": 0.0, "yaw_deg": 2.0}, {"x_m": 0.15, "y_m": 0.05, "yaw_deg": 20.0}, together=False
    ),
    "pose_noise": Imperfection(surveys.PoseNoise, {"xy_m": 0.02, "theta_deg": 0.5}, {"xy_m": 0.1, "theta_deg": 2.0}),
    "pose_drift": Imperfection(surveys.PoseDrift, {"share": 0.005}, {"share": 0.02}, together=False),
    "headings": Imperfection(surveys.Headings, {"sd_deg": 20.0}, {"sd_deg": 180.0}, together=False),
    "clock": Imperfection(surveys.Clock, {"seconds": 0.1}, {"seconds": 0.3}),
    "odometry": Imperfection(
        surveys.Odometry, {"scale": 0.05, "drift_deg_per_m": 2.0}, {"scale": 0.15, "drift_deg_per_m": 6.0}
    ),
    "foliage": Imperfection(scenery.Foliage, {"per_m3": 5.0}, {"per_m3": 20.0}, together=False),
    "people": Imperfection(scenery.People, {"share": 0.15}, {"share": 0.35}, where="drives"),
    "reflections": Imperfection(scenery.Reflections, {"gloss": 0.5}, {"gloss": 1.0}),
    "mount_tilt": Imperfection(mounting.Tilt, {"degrees": 1.0}, {"degrees": 3.0}),
    "centre": Imperfection(mounting.Centre, {"pixels": 2.0}, {"pixels": 5.0}, together=False, calibrated=True),
    "body": Imperfection(scenery.Body, {"strut_deg": 8.0}, {"strut_deg": 20.0, "laptop_share": 0.33}),
    "defocus": Imperfection(lens.Defocus, {"sigma_deg": 1.5}, {"sigma_deg": 3.0}),
    "motion_blur": Imperfection(lens.MotionBlur, {"degrees": 3.0}, {"degrees": 8.0}, where="drives"),
    "vignetting": Imperfection(lens.Vignetting, {"share": 0.4}, {"share": 0.7}),
    "flare": Imperfection(
        lens.Flare, {"share": 0.1, "sigma_deg": 4.0, "veil": 0.03}, {"share": 0.3, "sigma_deg": 8.0, "veil": 0.1}
    ),
    "exposure": Imperfection(lens.Exposure, {"stops": 0.3, "tint": 0.05}, {"stops": 0.8, "tint": 0.15}),
    "sensor": Imperfection(
        lens.Sensor,
        {"full_well": 4000.0, "read_noise": 20.0, "pattern": 0.01, "broken": 0.0002},
        {"full_well": 1000.0, "read_noise": 20.0, "pattern": 0.03, "broken": 0.002},
        together=False,
    ),
    "jpeg": Imperfection(lens.Jpeg, {"quality": 50}, {"quality": 20}),
    "focal": Imperfection(mounting.Focal, {"scale": 1.02}, {"scale": 1.05}, together=False, calibrated=True),
    "elevation_scale": Imperfection(mounting.Elevation, {"scale": 1.03}, {"scale": 1.1}, together=False, calibrated=True),
    "elevation_shift": Imperfection(mounting.Elevation, {"shift_deg": 1.0}, {"shift_deg": 3.0}, calibrated=True),
    "height": Imperfection(mounting.Height, {"metres": 0.03}, {"metres": 0.1}, calibrated=True),
}


@dataclass(frozen=True)
class Use:
    """An imperfection in a recipe.

    Parameters
    ----------
    name : str
        Of `IMPERFECTIONS`.
    settings : StrictModel
        Its parameters.
    where : str
        Which images.
    """

    name: str
    settings: StrictModel
    where: str

    def apply(self, draft: Draft, rng: np.random.Generator, told: bool = False) -> None:
        """Change a draft; ``told``: and say in it all that somebody can know who has looked at the robot and calibrated it."""
        if told and IMPERFECTIONS[self.name].calibrated:
            return
        if IMPERFECTIONS[self.name].changes_data:
            cast(_Change, self.settings).change(draft, rng)
        else:
            for folder in draft.of(self.where):
                folder.disturbances.append((self.name, cast(Disturbance, self.settings)))
        if told and hasattr(self.settings, "tell"):
            self.settings.tell(draft)
