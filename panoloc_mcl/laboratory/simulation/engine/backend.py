"""Mitsuba 3: the one file that imports it, with the fastest of its variants that works on this machine."""

from __future__ import annotations

import importlib
import importlib.util
import os
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.engine.llvm import VARIABLE, Choice, choose
from panoloc_mcl.robot.errors import ConfigError

LLVM, SCALAR = VARIANTS = ("llvm_ad_rgb", "scalar_rgb")


@dataclass(frozen=True)
class Backend:
    """Mitsuba with one of its variants set.

    Parameters
    ----------
    mi : module
    variant : str
        ``llvm_ad_rgb``, or ``scalar_rgb`` when no LLVM library works.
    remark : str
        A line for the user about that choice; empty if there is nothing to say.
    """

    mi: Any
    variant: str
    remark: str = ""

    @property
    def vectorised(self) -> bool:
        """Whether it works on many rays at once."""
        return self.variant.startswith("llvm")


@cache
def backend(variant: str | None = None) -> Backend:
    """Mitsuba, with LLVM if there is a library of it that works on this machine.

    Parameters
    ----------
    variant : str, optional
        One of ``VARIANTS``; or the environment variable ``PANOLOC_MITSUBA_VARIANT``.

    Raises
    ------
    ConfigError
        Mitsuba is not installed, or cannot use this variant.
    """
    if importlib.util.find_spec("mitsuba") is None:
        raise ConfigError("simulate: needs Mitsuba 3; install the extra: pip install 'panoloc-mcl[simulate]'")
    wanted = variant or os.environ.get("PANOLOC_MITSUBA_VARIANT")
    if wanted is not None and wanted not in VARIANTS:
        raise ConfigError(f"PANOLOC_MITSUBA_VARIANT = '{wanted}': must be one of {', '.join(VARIANTS)}")
    remark = ""
    if wanted != SCALAR:
        choice = choose()
        if choice.library is not None:
            return set_up(LLVM, choice)
        if wanted == LLVM:
            raise ConfigError(f"PANOLOC_MITSUBA_VARIANT = '{LLVM}': {choice.remark}")
        remark = f"rendering with {SCALAR}, several times slower: {choice.remark}"
    return set_up(SCALAR, Choice(None, remark))


def set_up(variant: str, choice: Choice) -> Backend:
    """Mitsuba with a variant, and the library that was chosen for it.

    Raises
    ------
    ConfigError
        Mitsuba refuses.
    """
    # Before the import: DrJit reads it then.
    if choice.library is not None:
        os.environ[VARIABLE] = str(choice.library)
    try:
        mi = importlib.import_module("mitsuba")
        mi.set_variant(variant)
    except (ImportError, RuntimeError) as error:
        raise ConfigError(f"simulate: Mitsuba cannot use {variant} ({error}); install the extra simulate again") from error
    return Backend(mi, variant, choice.remark)


def opaque(kind: Any, value: float) -> Any:
    """A number that does not become part of the program: every call with another one would be compiled anew."""
    return importlib.import_module("drjit").opaque(kind, value)


def mesh(
    mi: Any,
    name: str,
    vertices: NDArray[Any],
    faces: NDArray[Any],
    albedo: NDArray[np.float64] | None = None,
    luminance: float = 0.0,
) -> Any:
    """A matt mesh, lit or shining.

    Parameters
    ----------
    mi : module
    name : str
    vertices : ndarray, shape (v, 3)
        Those that no face uses are left out.
    faces : ndarray of int, shape (f, 3)
    albedo : ndarray of float64, shape (f,), optional
        Of the faces; without it the mesh is only there to be hit.
    luminance : float
        Of its light, cd/m2.
    """
    used = np.unique(faces)
    renumbered = np.searchsorted(used, faces)
    properties = mi.Properties()
    if albedo is not None:
        properties["bsdf"] = mi.load_dict(
            {
                "type": "twosided",
                "bsdf": {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "face_albedo"}},
            }
        )
    if luminance > 0.0:
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": float(luminance)}})
    made = mi.Mesh(name, len(used), len(faces), has_vertex_normals=False, has_vertex_texcoords=False, props=properties)
    if albedo is not None:
        made.add_attribute("face_albedo", 1, np.asarray(albedo, dtype=np.float32))
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = np.ascontiguousarray(vertices[used], dtype=np.float32).ravel()
    parameters["faces"] = np.ascontiguousarray(renumbered, dtype=np.uint32).ravel()
    parameters.update()
    return made
