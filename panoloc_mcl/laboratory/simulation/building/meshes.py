"""Meshes of a scene, read by trimesh."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.simulation.building.surfaces import CELL_M, Surfaces
from panoloc_mcl.laboratory.simulation.scene import Mesh
from panoloc_mcl.robot.errors import ConfigError

FloatArray = NDArray[np.float64]


def put_mesh(surfaces: Surfaces, thing: Mesh, index: int, folder: Path) -> None:
    """Put up the mesh that is number ``index`` of a scene; relative paths start at ``folder``."""
    path = thing.file if thing.file.is_absolute() else folder / thing.file
    vertices, faces, albedo = read_mesh(path, f"objects.{index}.file")
    if thing.y_up:
        vertices = vertices[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0])
    turn = math.radians(thing.place[3])
    c, s = math.cos(turn), math.sin(turn)
    placed = (vertices * thing.scale) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + np.array(thing.place[:3])
    for face, shade in zip(faces, albedo, strict=True):
        a, b, c3 = placed[face]
        if np.linalg.norm(np.cross(b - a, c3 - a)) < 1e-10:
            continue
        texture = np.full((1, 1), shade if thing.albedo is None else thing.albedo, np.float32)
        surfaces.parts.add(a, b - a, c3 - a, texture, CELL_M, triangle=True)
        low, high = float(placed[face, 2].min()), float(placed[face, 2].max())
        if high > 0.05 and high - low > 0.02:
            surfaces.parts.obstacle(placed[face, :2], low, high)


def read_mesh(path: Path, where: str) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
    """Vertices (v, 3), triangles (f, 3) and their albedos (f,) of a mesh file; colours are taken as sRGB.

    Raises
    ------
    ConfigError
        No such file, trimesh is not installed, or nothing that it can read.
    """
    if not path.is_file():
        raise ConfigError(f"{where} = '{path}': no such file; check the path")
    try:
        import trimesh
    except ImportError as error:
        raise ConfigError(f"{where} = '{path}': meshes need trimesh; install the extra 'simulate'") from error
    try:
        mesh = trimesh.load(path, force="mesh")
        colours = np.asarray(mesh.visual.to_color().face_colors if mesh.visual.kind == "texture" else mesh.visual.face_colors)
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:  # its readers raise whatever comes
        raise ConfigError(f"{where} = '{path}': cannot be read as a mesh ({error}); write glTF, OBJ, PLY or STL") from error
    if len(faces) == 0:
        raise ConfigError(f"{where} = '{path}': holds no triangles; check the export")
    linear = (colours[:, :3].astype(np.float64) / 255.0) ** 2.2
    return vertices, faces, np.clip(linear @ np.array([0.2126, 0.7152, 0.0722]), 0.02, 0.9)
