"""All that is asked of Mitsuba, in very small: ``llvm.py`` runs this in a process of its own to see whether a library works."""

from __future__ import annotations

import numpy as np

from panoloc_mcl.laboratory.simulation.engine.backend import LLVM, set_up
from panoloc_mcl.laboratory.simulation.engine.llvm import Choice
from panoloc_mcl.laboratory.simulation.patches import PatchList, assemble
from panoloc_mcl.laboratory.simulation.renderer import Daylight, LightTransport, RayCaster, sources_of
from panoloc_mcl.laboratory.simulation.scene import Light, Site


def trial() -> None:
    """All that is asked of Mitsuba, in very small, with the library that ``DRJIT_LIBLLVM_PATH`` names.

    A library that does not fit the processor ends the process.

    Raises
    ------
    RuntimeError
        It computes something else than it should.
    """
    used = set_up(LLVM, Choice(None, ""))
    parts = PatchList()
    grey = np.full((1, 1), 0.5, dtype=np.float32)
    parts.add((-2.0, -2.0, 0.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0), grey, 1.0)
    parts.add((-2.0, 2.0, 2.0), (4.0, 0.0, 0.0), (0.0, -4.0, 0.0), grey, 1.0, parts.light_source("pane", "pane", 0.5))
    patches = assemble(parts)
    distance, owner = RayCaster(patches, used).cast(np.array([0.0, 0.0, 1.5]), np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]))
    site, light = Site(), Light()
    sources = sources_of(patches, site, light, 0.3, used)
    lux = LightTransport(patches, sources, Daylight(site, light), used).light_map(8, 1, lambda done, total: None)
    hit = np.allclose(distance, [1.5, np.inf], rtol=1e-3) and owner.tolist() == [0, -1]
    if not (hit and np.isfinite(lux).all() and lux.max() > 0.0):
        raise RuntimeError("computes something else than it should")
