"""Depth from neighbouring references, views from where no camera ever stood, and the pose that fits an image best."""

from panoloc_mcl.robot.synthesis.depth import sweep_profiles
from panoloc_mcl.robot.synthesis.map_error import learn_source_errors
from panoloc_mcl.robot.synthesis.plausibility import PoseCheck, check_poses
from panoloc_mcl.robot.synthesis.refinement import PoseRefiner
from panoloc_mcl.robot.synthesis.source_errors import UNKNOWN, SourceErrors
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer
from panoloc_mcl.robot.synthesis.virtual_places import places_of, synthetic_features, virtual_positions

__all__ = [
    "UNKNOWN",
    "PoseCheck",
    "PoseRefiner",
    "SourceErrors",
    "ViewSynthesizer",
    "check_poses",
    "learn_source_errors",
    "places_of",
    "sweep_profiles",
    "synthetic_features",
    "virtual_positions",
]
