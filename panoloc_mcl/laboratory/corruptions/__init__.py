"""Corruptions of images and sequences for tests and studies: one definition used by all."""

from panoloc_mcl.laboratory.corruptions.dataset import corrupt
from panoloc_mcl.laboratory.corruptions.images import bars, blobs, blur, gain, lean, noise, random_pixels, spatial_light, tilt
from panoloc_mcl.laboratory.corruptions.imperfections import IMPERFECTIONS, LEVELS
from panoloc_mcl.laboratory.corruptions.recipe import CORRUPTIONS, Recipe, parse_recipe
from panoloc_mcl.laboratory.corruptions.sequences import drop_frames

__all__ = [
    "CORRUPTIONS",
    "IMPERFECTIONS",
    "LEVELS",
    "Recipe",
    "bars",
    "blobs",
    "blur",
    "corrupt",
    "drop_frames",
    "gain",
    "lean",
    "noise",
    "parse_recipe",
    "random_pixels",
    "spatial_light",
    "tilt",
]
