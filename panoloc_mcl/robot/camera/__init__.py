"""Cameras: what their images show, and how they become canonical panoramas."""

from panoloc_mcl.robot.camera.panorama import Panorama, PanoramaGeometry
from panoloc_mcl.robot.camera.profiles import radius_px
from panoloc_mcl.robot.camera.spec import (
    Camera,
    EquiangularProfile,
    HyperbolicProfile,
    LinearProfile,
    OmniCamera,
    PanoramaCamera,
    PanoramaTarget,
    Profile,
    TableProfile,
    UnifiedProfile,
    camera_from_mapping,
    to_mapping,
)
from panoloc_mcl.robot.camera.unwrap import Unwrapper, geometry_of

__all__ = [
    "Camera",
    "EquiangularProfile",
    "HyperbolicProfile",
    "LinearProfile",
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
