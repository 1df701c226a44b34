"""Numbers of a camera's description that a search may turn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from panoloc_mcl.robot.camera import AnyCamera, Mount

#: From a camera and a value to the camera with that value.
Change = Callable[[AnyCamera, float], AnyCamera]


@dataclass(frozen=True)
class Parameter:
    """One number.

    Parameters
    ----------
    name : str
        As the table says it.
    unit : str
        ``deg``, ``m``, ``px`` or nothing.
    start : float
        Value of the camera as it is described.
    step : float
        For derivatives: about half a pixel of the panorama.
    largest : float
        How far off it may be before it is looked for; with four times the standard deviation that the data leave, it is not observable.
    accuracy : float
        What the search errs by, however many images there are: views are interpolated, and no world is all floor and walls. As found
        in rooms whose camera is known.
    change : callable
    """

    name: str
    unit: str
    start: float
    step: float
    largest: float
    accuracy: float
    change: Change


def of_tilt(mount: Mount) -> list[Parameter]:
    """How the camera leans on its mount."""
    return [
        of_mount("pitch", "deg", mount.pitch_deg, 0.25, 8.0, 0.02, "pitch_deg"),
        of_mount("roll", "deg", mount.roll_deg, 0.25, 8.0, 0.02, "roll_deg"),
    ]


def of_mount(name: str, unit: str, start: float, step: float, largest: float, accuracy: float, key: str) -> Parameter:
    """A number of the mount (see `Parameter`), and the field ``key`` that holds it."""

    def change(camera: AnyCamera, value: float) -> AnyCamera:
        return camera.model_copy(update={"mount": camera.mounting.model_copy(update={key: value})})

    return Parameter(name, unit, start, step, largest, accuracy, change)


def changed(camera: AnyCamera, parameters: list[Parameter], values: Mapping[str, float]) -> AnyCamera:
    """The camera with other values of some parameters."""
    for parameter in parameters:
        if parameter.name in values:
            camera = parameter.change(camera, values[parameter.name])
    return camera
