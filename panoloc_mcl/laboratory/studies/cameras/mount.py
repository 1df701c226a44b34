"""How well one short drive can tell where a camera sits on the base: the Cramér-Rao bound, and what `place_camera` reaches.

The bound takes wheels that err by a share of their way from image to image, and by nothing else; headings are taken as exact. Poses of
images are those of the ground truth with noise, as a map gives them; odometry is that of the data set.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.tools.calibration.odometry import FEWEST_IMAGES, place_camera
from panoloc_mcl.tools.datasets import Sequence, Trajectory, read_dataset, resolve_dataset

Float64 = NDArray[np.float64]

#: Of the way from image to image by odometry, and of an image's pose.
NOISE_OF_LENGTHS, IMAGE_M, IMAGE_RAD = 0.1, 0.0015, np.radians(0.02)
#: Where the camera sits on the base.
MOUNT = np.array([0.15, 0.05, 0.0])
#: Of each drive, evenly over it.
STRETCHES = 4
_WITHIN_M = 0.005
_HEADS = ("mm", "ahead: median", "ahead: of 10, nine are below", "aside: median", "aside: of 10, nine are below")


def study(dataset: str, metres: float = 5.0, progress: Progress = no_progress) -> Report:
    """Place the camera by stretches of all drives.

    Parameters
    ----------
    dataset : str
        With drives that have ground truth and odometry.
    metres : float
        Length of a stretch.
    progress : callable (done, total, what)

    Raises
    ------
    DatasetError
        No stretch with ground truth, odometry and enough images.
    """
    data, rng = read_dataset(resolve_dataset(dataset)), np.random.default_rng(0)
    chosen, bounds, reached = [], [], []
    for done, drive in enumerate(data.sequences.values(), start=1):
        for stretch in stretches(drive, metres):
            chosen.append(stretch)
            bounds.append(bound(stretch))
            reached.append(placed(stretch, rng))
        progress(done, len(data.sequences), "drives")
    if not chosen:
        raise DatasetError(f"{data.path}: no drive has ground truth, odometry and {FEWEST_IMAGES} images within {metres:g} m")
    images = np.median([len(stretch.times) for stretch in chosen])
    turns = np.median([stretch.turns_deg for stretch in chosen])
    report = Report(
        f"{len(chosen)} stretches of {metres:g} m of the drives of `{data.name}`, {images:.0f} images and {turns:.0f}° of turns each "
        f"in the median; the camera is {1e3 * MOUNT[0]:.0f} mm ahead and {1e3 * MOUNT[1]:.0f} mm aside."
    )
    found = np.array(reached)
    table = report.table("", _HEADS)
    for name, values in (
        ("least standard deviation", np.array(bounds)),
        ("claimed standard deviation", found[:, 2:]),
        ("error", np.abs(found[:, :2])),
    ):
        shares = [np.quantile(values[:, axis], share) for axis in (0, 1) for share in (0.5, 0.9)]
        table.add(name, *(Number(float(1e3 * share), 1) for share in shares))
    errors = report.table("", ("error", "root mean square, mm", f"within {1e3 * _WITHIN_M:g} mm, %"))
    for axis, name in enumerate(("ahead", "aside")):
        rms, within = np.sqrt(np.mean(found[:, axis] ** 2)), np.mean(np.abs(found[:, axis]) <= _WITHIN_M)
        errors.add(name, Number(float(1e3 * rms), 1), Number(float(100.0 * within), 0))
    return report


@dataclass(frozen=True, eq=False)
class Stretch:
    """Some images of a drive, in a row.

    Parameters
    ----------
    times : float64 (n,)
        Of the images, seconds.
    truth, odometry : Trajectory
        Of the whole drive.
    """

    times: Float64
    truth: Trajectory
    odometry: Trajectory

    @property
    def turns_deg(self) -> float:
        """Sum of all turns to either side, from one message of the odometry to the next."""
        at = self.odometry.times
        fine = at[(at >= self.times[0]) & (at <= self.times[-1])]
        return float(np.degrees(np.abs(between(self.truth.at(fine[:-1]), self.truth.at(fine[1:]))[:, 2]).sum()))


def stretches(drive: Sequence, metres: float) -> Iterator[Stretch]:
    """Those of a drive, evenly over it; none without ground truth, odometry, and enough images."""
    truth, odometry = drive.groundtruth, drive.odometry
    if truth is None or odometry is None:
        return
    first, last = max(truth.times[0], odometry.times[0]), min(truth.times[-1], odometry.times[-1])
    times = drive.times[(drive.times >= first) & (drive.times <= last)]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth.at(times)[:, :2], axis=0).T))])
    for begin in np.linspace(0.0, max(way[-1] - metres, 0.0), STRETCHES):
        chosen = times[(way >= begin) & (way <= begin + metres)]
        if len(chosen) >= FEWEST_IMAGES:
            yield Stretch(chosen, truth, odometry)


def bound(stretch: Stretch) -> Float64:
    """Least standard deviations of x and y of the mount, metres (2,); scale of the odometry and yaw of the camera are unknown, too."""
    times, truth, messages = stretch.times, stretch.truth, stretch.odometry.times
    stamps = np.union1d(times, messages[(messages > times[0]) & (messages < times[-1])])
    way = np.zeros((len(times) - 1, 2))
    np.add.at(way, np.searchsorted(times, stamps[:-1], side="right") - 1, np.diff(truth.at(stamps)[:, :2], axis=0))
    aside = np.stack([-way[:, 1], way[:, 0]], axis=-1)
    turns = np.diff(_rotations(truth.at(times)[:, 2]), axis=0)
    design = np.concatenate([np.stack([way, aside], axis=-1), turns], axis=2).reshape(-1, 4)
    links = np.diff(np.eye(len(times)), axis=0)
    covariance = IMAGE_M**2 * np.kron(links @ links.T, np.eye(2))
    for at, step in enumerate(way):
        covariance[2 * at : 2 * at + 2, 2 * at : 2 * at + 2] += NOISE_OF_LENGTHS**2 * np.outer(step, step)
    information = design.T @ np.linalg.solve(covariance, design)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information + 1e-9 * np.eye(4))))[2:])


def placed(stretch: Stretch, rng: np.random.Generator) -> Float64:
    """Errors of x and y of the mount, and the claimed standard deviations of them, metres (4,)."""
    seen = compose(stretch.truth.at(stretch.times), MOUNT)
    seen = seen + rng.normal(size=seen.shape) * (IMAGE_M, IMAGE_M, IMAGE_RAD)
    found = place_camera(stretch.times, seen, stretch.odometry.times, stretch.odometry.poses)
    # A stretch has enough images.
    assert found is not None
    return np.array([found.x_m - MOUNT[0], found.y_m - MOUNT[1], found.sd_x_m, found.sd_y_m])


def _rotations(headings: Float64) -> Float64:
    cos, sin = np.cos(headings), np.sin(headings)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
