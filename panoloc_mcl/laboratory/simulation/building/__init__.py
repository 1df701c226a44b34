"""From a scene's description to its surfaces."""

from panoloc_mcl.laboratory.simulation.building.building import Building, build

__all__ = ["Building", "build"]
