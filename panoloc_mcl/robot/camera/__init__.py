"""Cameras: what their images show, and how they become canonical panoramas."""

from panoloc_mcl.robot.camera.extent import geometry_of
from panoloc_mcl.robot.camera.mask import Mask
from panoloc_mcl.robot.camera.mount import Mount
from panoloc_mcl.robot.camera.panorama import Panorama, PanoramaGeometry
from panoloc_mcl.robot.camera.profiles import (
    EquiangularProfile,
    HyperbolicProfile,
    LinearProfile,
    Profile,
    TableProfile,
    UnifiedProfile,
    radius_px,
)
from panoloc_mcl.robot.camera.spec import (
    AnyCamera,
    Camera,
    EquirectangularCamera,
    Fisheye,
    FisheyePairCamera,
    LensCamera,
    OmniCamera,
    PanoramaCamera,
    PanoramaTarget,
    camera_from_mapping,
    to_mapping,
)
from panoloc_mcl.robot.camera.unwrap import Unwrapper

__all__ = [
    "AnyCamera",
    "Camera",
    "EquiangularProfile",
    "EquirectangularCamera",
    "Fisheye",
    "FisheyePairCamera",
    "HyperbolicProfile",
    "LensCamera",
    "LinearProfile",
    "Mask",
    "Mount",
    "OmniCamera",
    "Panorama",
    "PanoramaCamera",
    "PanoramaGeometry",
    "PanoramaTarget",
    "Profile",
    "TableProfile",
    "UnifiedProfile",
    "Unwrapper",
    "camera_from_mapping",
    "geometry_of",
    "radius_px",
    "to_mapping",
]
