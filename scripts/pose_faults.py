"""Wrong poses of references: how many a map finds when it is built, and how many right ones it blames. Prints Markdown.

    python scripts/pose_faults.py [--dataset PATH_OR_NAME ...] [--draws N] [--seed S] [--within METRES]

One disturbance at a time: two poses swapped (any two, or neighbours), one pose 1.5 m off in a random direction, one heading 30 degrees
off; and all poses disturbed by 2 cm and 1 degree rms, which must pass. With ``--within``, only references so close to the disturbed
ones (their true and their wrong places) are looked at, which saves most of the time on large maps.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.references import ReferencePanoramas, read_references
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, check_poses, sweep_profiles
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.evaluation import wilson95

SHIFT_M, TURN_DEG, SWAPS = 1.5, 30.0, ("two poses swapped", "two neighbours swapped")
KINDS = (*SWAPS, f"one pose {SHIFT_M:g} m off", f"one heading {TURN_DEG:g} degrees off")
RMS = "all poses 2 cm and 1 degree rms"


def turned(image: np.ndarray, degrees: float) -> np.ndarray:
    """The panorama after another turn."""
    rows, columns = np.indices(image.shape, dtype=np.float64)
    columns += degrees * image.shape[1] / 360.0
    return np.clip(np.rint(map_coordinates(image.astype(np.float64), [rows, columns], order=1, mode="grid-wrap")), 0, 255)


def disturbed(references: ReferencePanoramas, kind: str, rng: np.random.Generator) -> tuple[ReferencePanoramas, list[int]]:
    """References with wrong poses, and which they are."""
    positions, pixels, count = references.positions.copy(), references.pixels.copy(), len(references)
    first = int(rng.integers(count))
    bad = [first]
    if kind in SWAPS:
        nearest = int(np.asarray(cKDTree(positions).query(positions[first], k=2)[1])[1])
        other = nearest if kind == SWAPS[1] else int(rng.choice(np.delete(np.arange(count), first)))
        bad.append(other)
        positions[[first, other]] = positions[[other, first]]
    elif kind == KINDS[2]:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        positions[first] += SHIFT_M * np.array([np.cos(angle), np.sin(angle)])
    elif kind == KINDS[3]:
        pixels[first] = turned(pixels[first], TURN_DEG * rng.choice([-1.0, 1.0]))
    else:
        bad = []
        positions += rng.normal(0.0, 0.02, positions.shape)
        for index in range(count):
            pixels[index] = turned(pixels[index], rng.normal(0.0, 1.0))
    return replace(references, positions=positions, pixels=pixels), bad


def judged(references: ReferencePanoramas, threads: int) -> tuple[set[str], set[str], bool]:
    """Names that are refused, names that only get no virtual places, and whether the map has any."""
    settings = VotesSettings()
    height = references.camera_height_m
    assert height is not None
    profiles = sweep_profiles(references, height, settings, threads=threads)
    check = check_poses(
        ViewSynthesizer(references, profiles, height), Places(references.positions).spacing, settings, threads=threads
    )
    refused = {fault.removeprefix("reference ").split(":")[0] for fault in check.faults}
    return refused, {references.names[index] for index in np.flatnonzero(check.alone)} - refused, check.helps


def near(original: ReferencePanoramas, now: ReferencePanoramas, bad: list[int], within: float) -> ReferencePanoramas:
    """Those references that have to do with the bad ones."""
    points = np.concatenate([original.positions[bad], now.positions[bad]])
    keep = np.flatnonzero(cKDTree(points).query(now.positions)[0] <= within)
    return replace(now, pixels=now.pixels[keep], positions=now.positions[keep], names=tuple(now.names[k] for k in keep))


def rows(name: str, draws: int, seed: int, within: float | None, threads: int) -> Iterator[str]:
    """Lines of the table for one data set."""
    dataset = read_dataset(resolve_dataset(name))
    original = read_references(dataset.references)
    refused, alone, helps = judged(original, threads)
    yield f"| {dataset.name}, as it is | - | - | {len(refused)} of {len(original)} | {len(alone)} | {helps} |"
    for kind in (*KINDS, RMS):
        rng = np.random.default_rng(seed)
        wrong = found = blamed = right = set_aside = set_aside_wrong = 0
        every_time_virtual = True
        for _ in range(1 if kind == RMS else draws):
            references, bad = disturbed(original, kind, rng)
            culprits = {references.names[index] for index in bad}
            part = near(original, references, bad, within) if within is not None and bad else references
            refused, alone, helps = judged(part, threads)
            wrong, found = wrong + len(culprits), found + len(culprits & refused)
            right, blamed = right + len(part) - len(culprits), blamed + len(refused - culprits)
            set_aside, set_aside_wrong = set_aside + len(alone - culprits), set_aside_wrong + len(alone & culprits)
            every_time_virtual &= helps
        recall = "-"
        if wrong:
            low, high = wilson95(found, wrong) or (0.0, 1.0)
            recall = f"{found} of {wrong} ({100 * low:.0f} to {100 * high:.0f} %)"
        yield (
            f"| {dataset.name}, {kind} | {recall} | {set_aside_wrong} | {blamed} of {right} | {set_aside} | {every_time_virtual} |"
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--dataset", action="append", help="path of a data set, or the name of an embedded one; may be repeated"
    )
    parser.add_argument("--draws", type=int, default=10, help="disturbances of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--within", type=float, help="metres around the disturbed references; all if left out")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    print(
        "| disturbance | wrong poses refused (95 %) | wrong, only without virtual places | right poses refused "
        "| right, without virtual places | map has virtual places |"
    )
    print("|---|---|---|---|---|---|")
    for name in arguments.dataset or ["hall"]:
        for row in rows(name, arguments.draws, arguments.seed, arguments.within, arguments.threads):
            print(row, flush=True)


if __name__ == "__main__":
    main()
