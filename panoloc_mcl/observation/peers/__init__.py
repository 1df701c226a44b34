"""The cited peers: observation models of the literature, each as its authors describe it."""

from panoloc_mcl.observation.peers.eigenspace import EigenspaceModel
from panoloc_mcl.observation.peers.fourier_signature import FourierSignatureModel
from panoloc_mcl.observation.peers.least_squares import LeastSquaresModel
from panoloc_mcl.observation.peers.orientation_correlation import OrientationCorrelationModel
from panoloc_mcl.observation.peers.spinning import SpinningModel
from panoloc_mcl.observation.peers.zero_phase import ZeroPhaseModel

__all__ = [
    "EigenspaceModel",
    "FourierSignatureModel",
    "LeastSquaresModel",
    "OrientationCorrelationModel",
    "SpinningModel",
    "ZeroPhaseModel",
]
