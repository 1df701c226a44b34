"""Wrong poses of references: how many a map finds when it is built, and how many right ones it blames."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from panoloc_mcl.laboratory.reports import Rate, Report
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas, read_references
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, check_poses, sweep_profiles
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset

SHIFT_M, TURN_DEG = 1.5, 30.0
#: Small errors that must pass: standard deviations of x, of y, and of the heading.
RMS_M, RMS_DEG = 0.02, 1.0
SWAP, SWAP_NEAR, MOVED, TURNED = (
    "two poses swapped",
    "two neighbours swapped",
    f"one pose {SHIFT_M:g} m off",
    f"one heading {TURN_DEG:g} degrees off",
)
KINDS = (SWAP, SWAP_NEAR, MOVED, TURNED)
RMS = f"all poses {100 * RMS_M:g} cm and {RMS_DEG:g} degree rms"


def study(
    datasets: Sequence[str],
    draws: int = 10,
    seed: int = 0,
    within: float | None = None,
    threads: int | None = None,
    progress: Progress = no_progress,
) -> Report:
    """Disturb the references' poses, one way at a time, and see what the check of the poses says.

    Parameters
    ----------
    datasets : sequence of str
    draws : int
        Disturbances of each kind.
    seed : int
    within : float, optional
        Metres around the disturbed references (their true and their wrong places): only references so near are looked at, which
        saves most of the time on large maps.
    threads : int, optional
        All cores if left out.
    progress : callable (done, total, what)
    """
    report = Report(
        f"Poses of references disturbed one way at a time, {draws} draws of each kind, seed {seed}. "
        "Intervals take every draw as one trial."
    )
    table = report.table(
        "",
        (
            "data set",
            "disturbance",
            "wrong poses left out (95 %)",
            "wrong, only without virtual places",
            "right poses left out",
            "right, without virtual places",
            "map has virtual places",
        ),
    )
    done, total = 0, len(datasets) * (2 + len(KINDS) * draws)
    for name in datasets:
        dataset = read_dataset(resolve_dataset(name))
        original = read_references(dataset.references)
        for kind in ("as it is", *KINDS, RMS):
            rng, tally = np.random.default_rng(seed), Tally()
            for draw in range(draws if kind in KINDS else 1):
                references, bad = disturbed(original, kind, rng)
                part = near(original, references, bad, within) if within is not None and bad else references
                tally.count(draw, part, {references.names[index] for index in bad}, *judged(part, threads))
                done += 1
                progress(done, total, "disturbances")
            table.add(dataset.name, kind, *tally.cells())
    return report


@dataclass
class Tally:
    """What the check said over the draws of one kind."""

    found: list[tuple[str, bool]] = field(default_factory=list)
    set_aside_wrong: int = 0
    set_aside: int = 0
    blamed: int = 0
    right: int = 0
    helps: bool = True

    def count(
        self, draw: int, references: ReferencePanoramas, wrong: set[str], refused: set[str], alone: set[str], helps: bool
    ) -> None:
        """One draw: which poses are wrong, which were refused, which only get no virtual places, and whether the map has any."""
        self.found += [(str(draw), name in refused) for name in wrong]
        self.set_aside_wrong += len(alone & wrong)
        self.set_aside += len(alone - wrong)
        self.blamed += len(refused - wrong)
        self.right += len(references) - len(wrong)
        self.helps &= helps

    def cells(self) -> tuple[Any, ...]:
        """Of its row."""
        blamed = f"{self.blamed} of {self.right}"
        return Rate.over(self.found), self.set_aside_wrong, blamed, self.set_aside, "yes" if self.helps else "no"


def disturbed(references: ReferencePanoramas, kind: str, rng: np.random.Generator) -> tuple[ReferencePanoramas, list[int]]:
    """References with wrong poses, and which they are."""
    positions, pixels, count = references.positions.copy(), references.pixels.copy(), len(references)
    first = int(rng.integers(count))
    bad = [first]
    if kind in (SWAP, SWAP_NEAR):
        nearest = int(np.asarray(cKDTree(positions).query(positions[first], k=2)[1])[1])
        other = nearest if kind == SWAP_NEAR else int(rng.choice(np.delete(np.arange(count), first)))
        bad.append(other)
        positions[[first, other]] = positions[[other, first]]
    elif kind == MOVED:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        positions[first] += SHIFT_M * np.array([np.cos(angle), np.sin(angle)])
    elif kind == TURNED:
        pixels[first] = turned(pixels[first], TURN_DEG * rng.choice([-1.0, 1.0]))
    else:
        bad = []
        if kind == RMS:
            positions += rng.normal(0.0, RMS_M, positions.shape)
            for index in range(count):
                pixels[index] = turned(pixels[index], rng.normal(0.0, RMS_DEG))
    return replace(references, positions=positions, pixels=pixels), bad


def turned(image: np.ndarray, degrees: float) -> np.ndarray:
    """The panorama after another turn."""
    rows, columns = np.indices(image.shape, dtype=np.float64)
    columns += degrees * image.shape[1] / 360.0
    return np.clip(np.rint(map_coordinates(image.astype(np.float64), [rows, columns], order=1, mode="grid-wrap")), 0, 255)


def judged(references: ReferencePanoramas, threads: int | None) -> tuple[set[str], set[str], bool]:
    """Names that are left out, names that only get no virtual places, and whether the map has any."""
    settings, threads = VotesSettings(), threads or os.cpu_count() or 1
    height = references.camera_height_m
    if height is None:
        raise DatasetError("the data set does not say how high the camera is; add camera.height_m to dataset.yaml")
    synthesizer = ViewSynthesizer(references, sweep_profiles(references, height, settings, threads=threads), height)
    check = check_poses(synthesizer, Places(references.positions).spacing, settings, threads=threads)
    refused = {references.names[index] for index in np.flatnonzero(check.doubted)}
    return refused, {references.names[index] for index in np.flatnonzero(check.alone)} - refused, check.helps


def near(original: ReferencePanoramas, now: ReferencePanoramas, bad: list[int], within: float) -> ReferencePanoramas:
    """Those references that have to do with the bad ones."""
    points = np.concatenate([original.positions[bad], now.positions[bad]])
    return now.of(np.flatnonzero(cKDTree(points).query(now.positions)[0] <= within))
