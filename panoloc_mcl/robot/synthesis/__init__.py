"""Depth from neighbouring references, views from where no camera ever stood, and the pose that fits an image best."""

from panoloc_mcl.robot.synthesis.depth import sweep_profiles
from panoloc_mcl.robot.synthesis.plausibility import PoseCheck, check_poses
from panoloc_mcl.robot.synthesis.refinement import PoseRefiner
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer
from panoloc_mcl.robot.synthesis.virtual_places import places_of, synthetic_features, virtual_positions

__all__ = [
    "PoseCheck",
    "PoseRefiner",
    "ViewSynthesizer",
    "check_poses",
    "places_of",
    "sweep_profiles",
    "synthetic_features",
    "virtual_positions",
]
