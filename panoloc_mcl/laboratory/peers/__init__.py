"""The cited peers: observation models of the literature, each as its authors describe it."""

from panoloc_mcl.laboratory.peers.eigenspace import EigenspaceModel
from panoloc_mcl.laboratory.peers.fourier_signature import FourierSignatureModel
from panoloc_mcl.laboratory.peers.least_squares import LeastSquaresModel
from panoloc_mcl.laboratory.peers.orientation_correlation import OrientationCorrelationModel
from panoloc_mcl.laboratory.peers.spinning import SpinningModel
from panoloc_mcl.laboratory.peers.zero_phase import ZeroPhaseModel

__all__ = [
    "EigenspaceModel",
    "FourierSignatureModel",
    "LeastSquaresModel",
    "OrientationCorrelationModel",
    "SpinningModel",
    "ZeroPhaseModel",
]
