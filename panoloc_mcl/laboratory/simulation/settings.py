"""What ``panoloc simulate`` is told: the scene, the camera, the robot, and which sequences to drive."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from panoloc_mcl.robot.camera.spec import Camera, PanoramaCamera
from panoloc_mcl.robot.settings.validation import StrictModel, read_yaml, validate
from panoloc_mcl.tools.config.overrides import Override, apply, parse_overrides, source_at

Positive = Annotated[float, Field(gt=0.0, le=1e6)]
NonNegative = Annotated[float, Field(ge=0.0, le=1e6)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Name = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]


class Sensor(StrictModel):
    """From light to grey levels. The exposure is fixed over all lights, as in the paper."""

    full_scale_lux: Positive = Field(1500.0, description="A white surface lit by this much fills the sensor.")
    gamma: Annotated[float, Field(ge=0.5, le=4.0)] = 2.2
    full_well: Positive = Field(9000.0, description="Electrons at full scale; their shot noise is the image's.")
    read_noise: NonNegative = Field(14.0, description="Standard deviation, electrons.")
    samples: Annotated[int, Field(ge=1, le=8)] = Field(3, description="Rays along each side of a pixel.")


class Odometry(StrictModel):
    """What the wheels report: its rate, and its errors."""

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 6.4
    translation_noise: Share = Field(0.10, description="Standard deviation of a step's length, as a share of it.")
    rotation_noise: Share = Field(0.08, description="Standard deviation of a step's turn, as a share of it.")
    drift_deg_per_m: NonNegative = Field(1.0, description="Turn that creeps in with distance, to a side drawn once.")


class Drive(StrictModel):
    """How the robot goes about. ``waypoints`` are for the patrol; it turns on the spot at each and drives on."""

    kind: Literal["wander", "patrol", "turn"] = "wander"
    waypoints: tuple[tuple[float, float], ...] = ()
    speed_m_s: Annotated[float, Field(gt=0.0, le=5.0)] = 0.5
    turn_deg_s: Annotated[float, Field(gt=0.0, le=720.0)] = 60.0
    beside_m: NonNegative = Field(0.25, description="How far from the places of the references the way leads, at most.")

    @model_validator(mode="after")
    def _waypoints_for_the_patrol(self) -> Drive:
        if self.kind == "patrol" and len(self.waypoints) < 2:
            raise ValueError("patrol needs waypoints: at least two [x, y]")
        if self.kind != "patrol" and self.waypoints:
            raise ValueError(f"waypoints are for kind patrol, not {self.kind}; remove them")
        return self


class SequenceGroup(StrictModel):
    """Sequences of one kind: ``NAME_00``, ``NAME_01``, …"""

    name: Name
    count: Annotated[int, Field(ge=1, le=100)] = 1
    light: str
    frames: Annotated[int, Field(ge=1, le=100_000)]
    every_s: Positive = 1.25
    drive: Drive = Drive()
    people: Annotated[int, Field(ge=0, le=50)] = 0
    moved: Share = 0.0
    tilt_deg: Annotated[float, Field(ge=0.0, le=20.0)] = Field(0.0, description="Root mean square of the camera's tilt.")
    height_change_m: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.0
    auto_exposure: bool = False
    camera: Camera | None = None
    size: tuple[Annotated[int, Field(ge=4, le=8192)], Annotated[int, Field(ge=2, le=8192)]] | None = None


class ReferenceDrive(StrictModel):
    """References that are the frames of one drive through the place, at the headings that it has, instead of the scene's places."""

    frames: Annotated[int, Field(ge=2, le=100_000)]
    every_s: Positive = 0.8
    drive: Drive = Drive()


class Rendering(StrictModel):
    """How carefully light is carried."""

    samples: Annotated[int, Field(ge=8, le=65536)] = Field(256, description="Light paths from each cell of the light maps.")


class SimulationConfig(StrictModel):
    """The configuration of ``panoloc simulate``."""

    name: Name
    description: str = ""
    licence: str = "CC0-1.0"
    scene: str
    seed: Annotated[int, Field(ge=0)] = 0
    camera: Camera = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
    size: tuple[Annotated[int, Field(ge=4, le=8192)], Annotated[int, Field(ge=2, le=8192)]] = (360, 145)
    sensor: Sensor = Sensor()
    odometry: Odometry = Odometry()
    rendering: Rendering = Rendering()
    body: str | None = Field(None, description="A PNG of the images' size, transparent but for the robot, fixed to the camera.")
    floor_gloss: Share = Field(0.0, description="How much floors mirror: 1 = varnished, 0 = matt.")
    references_light: str
    references_moved: Share = 0.0
    references_drive: ReferenceDrive | None = None
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] | None = Field(None, description="JPEG instead of PNG.")
    sequences: tuple[SequenceGroup, ...] = ()

    @model_validator(mode="after")
    def _names_and_heights(self) -> SimulationConfig:
        names = [group.name for group in self.sequences]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"sequences: name '{name}' is given twice; rename one")
        for camera in (self.camera, *(group.camera for group in self.sequences)):
            if camera is not None and camera.height_m is None:
                raise ValueError("camera.height_m is missing; say how high the camera stands above the floor")
        return self


def load_simulation(path: Path, overrides: Sequence[str | Override] = ()) -> SimulationConfig:
    """Read a configuration; overrides beat the file.

    Raises
    ------
    ConfigError
        Every fault, one line each.
    """
    data, parsed = read_yaml(path), parse_overrides(overrides)
    for override in parsed:
        apply(data, override)
    return validate(SimulationConfig, data, lambda location: source_at(location, parsed, str(path)))
