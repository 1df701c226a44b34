"""What is in a map, a data set or a results folder: facts, and the figures behind the picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from panoloc_mcl.robot.eigenspace.pca import principal_components, spanned
from panoloc_mcl.robot.geometry import FloatArray
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import ObservationModel, Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.report.facts import facts
from panoloc_mcl.tools.report.mending import graph_lines, graph_values
from panoloc_mcl.tools.report.results.results_reader import Results

# More references are sampled evenly.
_MOST_REFERENCES = 200
_SHOWN_EIGENIMAGES = 5
_SHOWN_CONFUSIONS = 5
# What is nearer than this, in spacings, is a neighbour and not confused.
_NEIGHBOUR_SPACINGS = 1.6


@dataclass(frozen=True, eq=False)
class Eigenimages:
    """The grey-level eigenspace of reference panoramas.

    Parameters
    ----------
    mean : float32 (rows, columns)
        Grey levels.
    images : float32 (p, rows, columns)
        The first few, of length 1.
    kept : float64 (n,)
        Share of the variance that the first 1, 2, … of all hold.
    """

    mean: NDArray[np.float32]
    images: NDArray[np.float32]
    kept: FloatArray


@dataclass(frozen=True, eq=False)
class Confusion:
    """How much each reference's own image votes for the places of the others.

    Parameters
    ----------
    indices : int64 (n,)
        References that were looked at.
    shares : float64 (n, n)
        Votes of the best heading at the place of reference j for the image of reference i, as a share of its best votes.
    """

    indices: NDArray[np.int64]
    shares: FloatArray


@dataclass(frozen=True, eq=False)
class Inspection:
    """What was found.

    Parameters
    ----------
    kind : str
        ``map``, ``data set`` or ``results``.
    lines : tuple of (str, str)
        Label and text.
    values : dict
        The same for machines.
    """

    kind: str
    lines: tuple[tuple[str, str], ...]
    values: dict[str, Any]


def inspect_map(panorama_map: PanoramaMap, model: ObservationModel, confusion: Confusion, eigen: Eigenimages) -> Inspection:
    """Facts about a map."""
    references, places = panorama_map.references, model.places
    kept = getattr(model, "kept", None)
    confused = _most_confused(confusion, references.positions)
    lines = [
        ("map", panorama_map.name),
        ("observation model", panorama_map.observation.model),
        *_reference_lines(references),
        *graph_lines(panorama_map.keyframes),
        ("places voted for", f"{len(places)}, {places.spacing:.2f} m apart"),
        ("ground covered", f"{covered_m2(places):.1f} m², the shaded part of the picture"),
        ("variance kept", _share_text(kept)) if kept is not None else ("variance kept", "the model has no eigenspace"),
        ("grey-level eigenimages", _kept_text(eigen)),
        *[("confused", text) for text, _ in confused],
        *[("note", note) for note in panorama_map.notes],
    ]
    values = {
        "kind": "map",
        "name": panorama_map.name,
        "model": panorama_map.observation.model,
        **_reference_values(references),
        "graph": graph_values(panorama_map.keyframes),
        "places": len(places),
        "place_spacing_m": places.spacing,
        "covered_m2": covered_m2(places),
        "variance_kept": kept,
        "grey_variance_kept": eigen.kept.tolist(),
        "confused": [pair for _, pair in confused],
        "notes": list(panorama_map.notes),
    }
    return Inspection("map", tuple(lines), values)


def inspect_dataset(dataset: Dataset, references: ReferencePanoramas, eigen: Eigenimages) -> Inspection:
    """Facts about a data set."""
    drives: list[dict[str, Any]] = []
    for name, drive in dataset.sequences.items():
        duration = float(drive.times[-1] - drive.times[0]) if len(drive) else 0.0
        way = None
        if drive.groundtruth is not None and len(drive):
            way = float(np.hypot(*np.diff(drive.groundtruth.at(drive.times)[:, :2], axis=0).T).sum())
        odometry = None if drive.odometry is None or duration == 0.0 else len(drive.odometry) / duration
        drives.append(
            {
                "name": name,
                "images": len(drive),
                "seconds": duration,
                "metres": way,
                "odometry_hz": odometry,
                "truth": way is not None,
            }
        )
    lines = [
        ("data set", dataset.name + (f": {dataset.description}" if dataset.description else "")),
        ("licence", dataset.licence or "not given"),
        (
            "camera",
            f"{dataset.camera.kind}, images of {dataset.references.image_size[0]} x {dataset.references.image_size[1]} pixels",
        ),
        *_reference_lines(references),
        ("grey-level eigenimages", _kept_text(eigen)),
        ("sequences", f"{len(drives)}, {sum(drive['images'] for drive in drives)} images"),
        *[(str(drive["name"]), _drive_text(drive)) for drive in drives],
    ]
    values = {"kind": "dataset", "name": dataset.name, **_reference_values(references), "sequences": drives}
    return Inspection("data set", tuple(lines), values)


def inspect_results(results: Results) -> Inspection:
    """Facts about a results folder: what was run, and which places were taken for which."""
    taken: Counter[tuple[int, int]] = Counter()
    for record in results.records:
        if record.truth is None or not len(results.place_positions):
            continue
        known = record.has_truth
        nearest = Places(results.place_positions).nearest(record.truth[known, :2])
        taken.update((int(a), int(b)) for a, b in zip(nearest, record.best_place[known], strict=True) if a != b and b >= 0)
    lines = [
        *facts(results.run_info),
        ("places", str(len(results.place_positions))),
        ("runs in the folder", str(len(results.records))),
    ]
    positions = results.place_positions
    lines += [
        (
            "confused",
            f"place {b} was reported where {a} was nearest: {count} times, {np.hypot(*(positions[a] - positions[b])):.2f} m away",
        )
        for (a, b), count in taken.most_common(_SHOWN_CONFUSIONS)
    ]
    pairs = [{"nearest": a, "reported": b, "times": count} for (a, b), count in taken.most_common()]
    values = {"kind": "results", "run": dict(results.run_info), "metrics": dict(results.metrics), "confused": pairs}
    return Inspection("results", tuple(lines), values)


def covered_m2(places: Places) -> float:
    """Ground that the map holds on, square metres."""
    return float(len(places.covered)) * places.raster.cell**2


def eigenimages_of(references: ReferencePanoramas) -> Eigenimages:
    """Mean and eigenimages of the references' grey levels, at most 200 of them."""
    chosen = _sampled(len(references))
    pixels = references.pixels[chosen].reshape(len(chosen), -1).astype(np.float32)
    mean = pixels.mean(axis=0)
    pixels -= mean
    shape = references.pixels.shape[1:]
    with threadpool_limits(1, user_api="blas"):
        rank = spanned(pixels) if len(chosen) > 1 and pixels.any() else 0
        if rank == 0:
            return Eigenimages(mean.reshape(shape), np.zeros((0, *shape), dtype=np.float32), np.ones(1))
        space = principal_components(pixels, rank, "components")
    energy = np.sum(np.abs(space.coefficients.astype(np.float64)) ** 2, axis=0)
    first = space.eigenimages[:_SHOWN_EIGENIMAGES].reshape(-1, *shape)
    return Eigenimages(mean.reshape(shape), first, np.cumsum(energy) / energy.sum())


def confusion_of(references: ReferencePanoramas, model: ObservationModel, progress: Progress = no_progress) -> Confusion:
    """Let every reference's own image vote (at most 200 of them)."""
    chosen = _sampled(len(references))
    places = model.places.nearest(references.positions[chosen])
    shares = np.zeros((len(chosen), len(chosen)))
    with threadpool_limits(1, user_api="blas"):
        for row, index in enumerate(chosen):
            votes = model.observe(references.panorama(int(index)))
            best = votes.best_of_places
            shares[row] = best[places] / max(float(best.max()), 1e-12)
            progress(row + 1, len(chosen), "votes of references")
    return Confusion(chosen, shares)


def _sampled(count: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST_REFERENCES)).round().astype(np.int64))


def _most_confused(confusion: Confusion, positions: FloatArray) -> list[tuple[str, dict[str, Any]]]:
    """Pairs of references farther apart than neighbours, the most alike first, each pair once."""
    where = positions[confusion.indices]
    distance = np.hypot(*(where[:, None] - where[None]).T).T
    alike = np.where(distance > _NEIGHBOUR_SPACINGS * Places(positions).spacing, confusion.shares, 0.0)
    both = np.triu(np.maximum(alike, alike.T), 1)
    found = []
    for flat in np.argsort(-both, axis=None, kind="stable")[:_SHOWN_CONFUSIONS]:
        i, j = (int(index) for index in np.unravel_index(flat, both.shape))
        if both[i, j] <= 0.0:
            break
        a, b = int(confusion.indices[i]), int(confusion.indices[j])
        text = f"reference {a} with {b}, {distance[i, j]:.2f} m away: {100.0 * both[i, j]:.0f} % of its own votes"
        found.append((text, {"references": [a, b], "metres": float(distance[i, j]), "share": float(both[i, j])}))
    return found


def _reference_lines(references: ReferencePanoramas) -> list[tuple[str, str]]:
    geometry, (x, y) = references.geometry, references.positions.T
    height = "not given" if references.camera_height_m is None else f"{references.camera_height_m:g} m above the floor"
    seen = 1.0 if references.valid is None else float(references.valid.mean())
    return [
        ("references", f"{len(references)}, {Places(references.positions).spacing:.2f} m apart"),
        ("coverage", f"x {x.min():.2f} to {x.max():.2f} m, y {y.min():.2f} to {y.max():.2f} m"),
        (
            "panoramas",
            f"{geometry.width} x {geometry.height} pixels, elevation {geometry.elevation_bottom_deg:g}° to "
            f"{geometry.elevation_top_deg:g}°, {100.0 * seen:.0f} % seen",
        ),
        ("camera height", height),
    ]


def _reference_values(references: ReferencePanoramas) -> dict[str, Any]:
    geometry = references.geometry
    return {
        "references": len(references),
        "reference_spacing_m": Places(references.positions).spacing,
        "coverage_m": [*references.positions.min(axis=0).tolist(), *references.positions.max(axis=0).tolist()],
        "panorama": [geometry.width, geometry.height],
        "elevation_deg": [geometry.elevation_bottom_deg, geometry.elevation_top_deg],
        "camera_height_m": references.camera_height_m,
    }


def _kept_text(eigen: Eigenimages) -> str:
    parts = [f"{count}: {100.0 * eigen.kept[count - 1]:.0f} %" for count in (1, 5, 15, 30, 60) if count <= len(eigen.kept)]
    return "variance kept by the first " + ", ".join(parts)


def _share_text(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def _drive_text(drive: Mapping[str, Any]) -> str:
    way = "no ground truth" if drive["metres"] is None else f"{drive['metres']:.1f} m"
    odometry = "no odometry" if drive["odometry_hz"] is None else f"odometry at {drive['odometry_hz']:.1f} Hz"
    return f"{drive['images']} images, {drive['seconds']:.1f} s, {way}, {odometry}"
