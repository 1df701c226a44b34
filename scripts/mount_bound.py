#!/usr/bin/env python3
"""How well one short drive can tell where a camera sits on the base: the Cramer-Rao bound, and what `place_camera` reaches.

The bound takes wheels that err by a share of their way from image to image, and by nothing else; headings are taken as exact. Poses of
images are those of the ground truth with noise, as a map gives them; odometry is that of the data set.

Usage: mount_bound.py DATASET [METRES]
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.tools.calibration.odometry import FEWEST_IMAGES, place_camera
from panoloc_mcl.tools.datasets import Sequence, read_dataset

Float64 = NDArray[np.float64]

NOISE_OF_LENGTHS, IMAGE_M, IMAGE_RAD = 0.1, 0.0015, np.radians(0.02)
MOUNT = np.array([0.15, 0.05, 0.0])
WINDOWS = 4


def turn(heading: Float64) -> Float64:
    """Rotation matrices (..., 2, 2)."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)


def bound(drive: Sequence, times: Float64) -> Float64:
    """Least standard deviations of x and y of the mount, metres; scale of the odometry and yaw of the camera are unknown, too."""
    truth, odometry = drive.groundtruth, drive.odometry
    assert truth is not None
    assert odometry is not None
    stamps = np.union1d(times, odometry.times[(odometry.times > times[0]) & (odometry.times < times[-1])])
    poses = truth.at(stamps)
    steps = np.diff(poses[:, :2], axis=0)
    interval = np.searchsorted(times, stamps[:-1], side="right") - 1
    way = np.zeros((len(times) - 1, 2))
    np.add.at(way, interval, steps)
    turns = turn(truth.at(times)[:, 2])
    aside = np.stack([-way[:, 1], way[:, 0]], axis=-1)
    design = np.concatenate([np.stack([way, aside], axis=-1), np.diff(turns, axis=0)], axis=2).reshape(-1, 4)
    links = np.diff(np.eye(len(times)), axis=0)
    whole = IMAGE_M**2 * np.kron(links @ links.T, np.eye(2))
    for at, step in enumerate(way):
        whole[2 * at : 2 * at + 2, 2 * at : 2 * at + 2] += NOISE_OF_LENGTHS**2 * np.outer(step, step)
    information = design.T @ np.linalg.solve(whole, design)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information + 1e-9 * np.eye(4))))[2:])


def reached(drive: Sequence, times: Float64, rng: np.random.Generator) -> Float64:
    """Errors of x and y, and the claimed standard deviations of them."""
    truth, odometry = drive.groundtruth, drive.odometry
    assert truth is not None
    assert odometry is not None
    seen = compose(truth.at(times), MOUNT)
    seen = seen + rng.normal(size=seen.shape) * (IMAGE_M, IMAGE_M, IMAGE_RAD)
    found = place_camera(times, seen, odometry.times, odometry.poses)
    assert found is not None
    return np.array([found.x_m - MOUNT[0], found.y_m - MOUNT[1], found.sd_x_m, found.sd_y_m])


def main() -> None:
    """Print the table."""
    dataset, metres = read_dataset(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 5.0
    rng = np.random.default_rng(0)
    bounds, errors, counts, turned = [], [], [], []
    for drive in dataset.sequences.values():
        truth, odometry = drive.groundtruth, drive.odometry
        if truth is None or odometry is None:
            continue
        lo, hi = (f(truth.times[end], odometry.times[end]) for f, end in ((max, 0), (min, -1)))
        times = drive.times[(drive.times >= lo) & (drive.times <= hi)]
        poses = truth.at(times)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
        for begin in np.linspace(0.0, max(way[-1] - metres, 0.0), WINDOWS):
            chosen = times[(way >= begin) & (way <= begin + metres)]
            if len(chosen) < FEWEST_IMAGES:
                continue
            fine = odometry.times[(odometry.times >= chosen[0]) & (odometry.times <= chosen[-1])]
            bounds.append(bound(drive, chosen))
            errors.append(reached(drive, chosen, rng))
            counts.append(len(chosen))
            turns = np.abs(between(truth.at(fine[:-1]), truth.at(fine[1:]))[:, 2])
            turned.append(np.degrees(turns.sum()))
    found = np.array(errors)
    print(
        f"{len(bounds)} windows of {metres:g} m, {np.median(counts):.0f} images and {np.median(turned):.0f} degrees of turns each"
    )
    print("| mm | x: median | x: of 10, nine are below | y: median | y: of 10, nine are below |\n|---|---|---|---|---|")
    for name, table in (
        ("least standard deviation", np.array(bounds)),
        ("claimed standard deviation", found[:, 2:]),
        ("error reached", np.abs(found[:, :2])),
    ):
        cells = [f(1e3 * table[:, axis]) for axis in (0, 1) for f in (np.median, lambda column: np.quantile(column, 0.9))]
        print(f"| {name} | " + " | ".join(f"{cell:.1f}" for cell in cells) + " |")
    rms = 1e3 * np.sqrt((found[:, :2] ** 2).mean(axis=0))
    within = 100.0 * (np.abs(found[:, :2]) <= 0.005).mean(axis=0)
    print(
        f"root mean square of the errors: x {rms[0]:.1f} mm, y {rms[1]:.1f} mm; within 5 mm: x {within[0]:.0f} %, y {within[1]:.0f} %"
    )


if __name__ == "__main__":
    main()
