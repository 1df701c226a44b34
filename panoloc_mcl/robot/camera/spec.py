"""The ``camera:`` mapping of a data set, read and checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from panoloc_mcl.robot.camera.lenses import Lens, widest_angle
from panoloc_mcl.robot.camera.mask import Mask
from panoloc_mcl.robot.camera.mount import Angle, Mount
from panoloc_mcl.robot.camera.profiles import Point, Positive, Profile, radius_px
from panoloc_mcl.robot.errors import CameraError, ConfigError
from panoloc_mcl.robot.settings.validation import StrictModel, kind_tag, validate

Direction = Literal["clockwise", "counterclockwise"]


def _ordered_elevations(value: tuple[float, float]) -> tuple[float, float]:
    if not -90.0 <= value[0] < value[1] <= 90.0:
        raise ValueError("must be [bottom, top] with -90 <= bottom < top <= 90")
    return value


def _ordered_radii(value: tuple[float, float]) -> tuple[float, float]:
    if not 0.0 <= value[0] < value[1]:
        raise ValueError("must be [inner, outer] with 0 <= inner < outer")
    return value


Elevations = Annotated[tuple[float, float], AfterValidator(_ordered_elevations)]
Radii = Annotated[tuple[float, float], AfterValidator(_ordered_radii)]
PanoramaSize = tuple[Annotated[int, Field(ge=4, le=16384)], Annotated[int, Field(ge=2, le=16384)]]
ImageSize = tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]


class PanoramaTarget(StrictModel):
    """The panorama to make of an omnidirectional image.

    ``columns`` and ``heading_column`` say how others lay that panorama out; this package always makes the canonical one
    (clockwise, column 0 ahead) of the same size and elevations.
    """

    size: PanoramaSize
    elevation_deg: Elevations
    columns: Direction = "clockwise"
    heading_column: float = 0.0


class _Camera(StrictModel):
    """What all cameras have.

    ``mask`` is an image of the camera's own size, white where it shows the world. ``time_offset_s`` is added to the stamps of images
    to bring them to the clock of odometry. ``height_m`` is that above the floor.
    """

    height_m: Positive | None = None
    mask: Mask | None = None
    mount: Mount | None = None
    time_offset_s: Annotated[float, Field(ge=-10.0, le=10.0)] | None = None

    @property
    def mounting(self) -> Mount:
        """Where the camera sits; on the base itself, looking ahead, if nothing is said."""
        return self.mount or Mount()

    @property
    def stamp_offset_s(self) -> float:
        """Added to the stamps of images, seconds."""
        return self.time_offset_s or 0.0


class PanoramaCamera(_Camera):
    """Images that are unwrapped cylinders already.

    ``rows`` says how elevation runs down the image: linear in angle (``elevation``, the default), or, as most unwrappers of one-shot
    cameras leave it, linear in the radius of a given mirror or fisheye, from that of the top elevation to that of the bottom one.

    Centres of pixels lie at integers: column c covers ``c - 0.5`` to ``c + 0.5``. Of the same panorama exported at s times the size,
    ``heading_column`` h becomes ``s (h + 0.5) - 0.5``: 0 becomes 0.5 at twice the size.
    """

    kind: Literal["panorama"] = "panorama"
    columns: Direction = "clockwise"
    heading_column: float = 0.0
    elevation_deg: Elevations
    rows: Literal["elevation"] | Profile | None = None

    @model_validator(mode="after")
    def _rows_in_order(self) -> PanoramaCamera:
        if self.rows is not None and self.rows != "elevation":
            steps = np.diff(radius_px(self.rows, np.radians(np.linspace(*self.elevation_deg, 181))))
            if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
                raise ValueError(
                    f"rows: its radius neither keeps rising nor keeps falling over elevation_deg {list(self.elevation_deg)}; "
                    "check the profile and the elevations"
                )
        return self


class EquirectangularCamera(_Camera):
    """Full spheres of 2:1, as Ricoh Theta, Insta360 and GoPro MAX export them: any size, zenith at the upper edge.

    ``heading_column`` is the middle of the image unless something else is said. ``elevation_deg`` is the part of the sphere to use; a
    map leaves out by itself what it cannot explain. ``size`` is that of the panorama to make of it (columns, rows).
    """

    kind: Literal["equirectangular"] = "equirectangular"
    columns: Direction = "clockwise"
    heading_column: float | None = None
    elevation_deg: Elevations = (-90.0, 90.0)
    size: PanoramaSize | None = None


class _VerticalCamera(_Camera):
    """What raw images of a camera with a vertical axis have.

    ``looks`` says where the axis points: down (as a mirror above the camera does, or a fisheye under a ceiling) or up.
    ``azimuth`` is the sense in the image in which the robot's azimuth (left positive) grows: counter-clockwise for a camera that looks
    down, clockwise for one that looks up (filled in), and the other way round where the image is a mirror's.
    """

    kind: Literal["omni"] = "omni"
    heading_angle_deg: float = 90.0
    looks: Literal["down", "up"] | None = None
    azimuth: Direction = "counterclockwise"

    @model_validator(mode="before")
    @classmethod
    def _sense_by_where_it_looks(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and data.get("looks") == "up" and "azimuth" not in data:
            return {**data, "azimuth": "clockwise"}
        return data

    @property
    def looks_up(self) -> bool:
        """Whether the axis points to the zenith."""
        return self.looks == "up"


class OmniCamera(_VerticalCamera):
    """Raw images of a mirror or fisheye camera with a vertical axis, whose radius is a function of elevation."""

    center_px: Point
    valid_radius_px: Radii
    profile: Profile
    panorama: PanoramaTarget

    @model_validator(mode="after")
    def _sees_its_panorama(self) -> OmniCamera:
        inner, outer = self.valid_radius_px
        radius = radius_px(self.profile, np.radians(np.linspace(*self.panorama.elevation_deg, 181)), self.looks_up)
        if not np.any((radius >= inner) & (radius <= outer)):
            raise ValueError(
                f"the profile puts no elevation of panorama.elevation_deg {list(self.panorama.elevation_deg)} into "
                f"valid_radius_px [{inner:g}, {outer:g}]; check profile, elevations and radii"
            )
        return self


class LensCamera(_VerticalCamera):
    """Raw images of a camera with a vertical axis that another tool calibrated (kind ``omni``, with ``lens`` or ``file``).

    ``size_px`` is that of the images it was calibrated with. By default the panorama shows all that the lens does.
    """

    lens: Lens
    size_px: ImageSize | None = None
    valid_radius_px: Radii | None = None
    panorama: PanoramaTarget | None = None

    @property
    def center_px(self) -> Point:
        """Where the axis appears."""
        return self.lens.cx, self.lens.cy

    @property
    def radii(self) -> tuple[float, float]:
        """Inner and outer radius of the part to use, pixels from the centre."""
        return self.valid_radius_px or (0.0, np.inf)


class Fisheye(StrictModel):
    """One of the lenses of a camera with two: its model, where it looks, and how much of its field to use.

    ``yaw_deg``, ``pitch_deg``, ``roll_deg`` turn it from looking ahead, upright, like those of a mount. ``offset_px`` is where the
    image that its calibration was made with lies in the joint image (upper left corner).
    """

    lens: Lens
    yaw_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    roll_deg: Angle = 0.0
    offset_px: Point = (0.0, 0.0)
    field_deg: Annotated[float, Field(gt=0.0, le=360.0)] = 190.0
    size_px: ImageSize | None = None


class FisheyePairCamera(_Camera):
    """Two fisheyes back to back in one image, as dual-lens cameras deliver them raw.

    Every direction is read from the lens whose axis is nearer. A strip of ``seam_deg`` where both meet shows nothing, so
    that no edge of the joint votes. Of cameras that write a file for each lens, tables name those of the front: ``files`` are the
    word in their names, and what stands in its place in those of the back (``[front, back]`` for ``front/01.png`` and ``back/01.png``).
    """

    kind: Literal["fisheye_pair"] = "fisheye_pair"
    front: Fisheye
    back: Fisheye
    files: tuple[str, str] | None = None
    seam_deg: Annotated[float, Field(ge=0.0, le=20.0)] = 1.5
    panorama: PanoramaTarget | None = None

    @model_validator(mode="before")
    @classmethod
    def _back_to_back(cls, data: Any) -> Any:
        back = data.get("back") if isinstance(data, Mapping) else None
        if isinstance(back, Mapping) and "yaw_deg" not in back:
            return {**data, "back": {**back, "yaw_deg": 180.0}}
        return data

    @model_validator(mode="after")
    def _sees_its_panorama(self) -> FisheyePairCamera:
        for name, one in (("front", self.front), ("back", self.back)):
            if np.degrees(widest_angle(one.lens)) < 45.0:
                raise ValueError(f"{name}.lens shows less than 90 degrees; use the calibration of a fisheye")
        if self.files is not None and (not all(self.files) or self.files[0] == self.files[1]):
            raise ValueError(f"files: {list(self.files)} do not tell front from back; write two words of their names")
        if self.files is not None and self.back.offset_px[0] == 0.0:
            raise ValueError("back.offset_px: is missing; write [width of the front lens's images, 0], where the back's begin")
        return self


AnyCamera = PanoramaCamera | OmniCamera | LensCamera | EquirectangularCamera | FisheyePairCamera
_KIND_WORDS = "kind must be 'panorama', 'omni', 'equirectangular' or 'fisheye_pair'"


def _camera_tag(value: Any) -> str | None:
    tag = kind_tag(value)
    return "Lens" if tag == "Omni" and ("lens" in value if isinstance(value, Mapping) else hasattr(value, "lens")) else tag


Camera = Annotated[
    Annotated[PanoramaCamera, Tag("Panorama")]
    | Annotated[OmniCamera, Tag("Omni")]
    | Annotated[LensCamera, Tag("Lens")]
    | Annotated[EquirectangularCamera, Tag("Equirectangular")]
    | Annotated[FisheyePairCamera, Tag("Fisheye_pair")],
    Discriminator(_camera_tag, custom_error_type="camera_kind", custom_error_message=_KIND_WORDS),
]


_KINDS: dict[str, type[PanoramaCamera | OmniCamera | LensCamera | EquirectangularCamera | FisheyePairCamera]] = {
    "Panorama": PanoramaCamera,
    "Omni": OmniCamera,
    "Lens": LensCamera,
    "Equirectangular": EquirectangularCamera,
    "Fisheye_pair": FisheyePairCamera,
}


def camera_from_mapping(data: Mapping[str, Any], source: str) -> AnyCamera:
    """Check a camera mapping whose files have been read (see `camera_with_files`).

    Parameters
    ----------
    data : mapping
        As under ``camera:`` in a data set, or the whole of a ``camera.yaml``.
    source : str
        What to call it in a fault, usually the file.

    Raises
    ------
    CameraError
        Every fault, one line each: source, key, value and remedy.
    """
    kind, tag = data.get("kind"), _camera_tag(data)
    if tag not in _KINDS:
        raise CameraError(f"{source}: kind = {kind!r}: must be {_KIND_WORDS.removeprefix('kind must be ')}")
    try:
        return validate(_KINDS[tag], data, source)
    except ConfigError as error:
        raise CameraError(error.faults) from error


def to_mapping(camera: AnyCamera) -> dict[str, Any]:
    """Plain data for YAML that :func:`camera_from_mapping` reads back to an equal camera."""
    return camera.model_dump(mode="json", exclude_none=True)
