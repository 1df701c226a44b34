"""Depth from neighbouring references, views from where no camera ever stood, and the pose that fits an image best."""

from panoloc_mcl.synthesis.depth import sweep_profiles
from panoloc_mcl.synthesis.refinement import PoseRefiner
from panoloc_mcl.synthesis.views import ViewSynthesizer
from panoloc_mcl.synthesis.virtual_places import synthetic_features, virtual_positions

__all__ = ["PoseRefiner", "ViewSynthesizer", "sweep_profiles", "synthetic_features", "virtual_positions"]
