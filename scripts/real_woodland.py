"""A real route through a wood as a data set: 455 training panoramas and 94 queries of one robot, 120 x 25 pixels.

    python scripts/real_woodland.py OUT [--source CHECKOUT] [--every K] [--min-step METRES] [--scale N] [--bridged]

Recordings of Knight et al., "Insect-Inspired Visual Navigation On-Board an Autonomous Robot" (ALIFE 2019), from the public repository
BrainsOnBoard/alife_outdoor_navigation_paper, fetched with git unless --source names a checkout. That repository has no licence: use the
data for measurements on your own machine, and pass nothing of it on.

What is known of it: panoramas unwrapped linearly in the radius of an upward fisheye, elevation -27.5 to 90 degrees by its settings;
forward is column 59, and content moves to smaller columns when the robot turns left. Positions come from a video camera on a tripod and
are good to about 9 cm; errors are correlated, so medians that differ by 2 cm cannot be told apart. During the queries the robot was
out of sight seven times, for 9 to 21 seconds each: 36 of the 94 images have a true position; --bridged puts the others on straight
lines between. Headings were not measured: those
of the references are made to agree from image to image, with the track's direction as their mean; those of the queries are the track's
direction and wrong wherever the robot stands. The camera's height is read off a photograph. No odometry was recorded.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import lsqr

from panoloc_mcl.robot.camera import camera_from_mapping
from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.geometry import wrap_angle
from panoloc_mcl.tools.datasets import DatasetWriter, Trajectory

Float64 = NDArray[np.float64]

REPOSITORY = "https://github.com/BrainsOnBoard/alife_outdoor_navigation_paper"
COLUMNS, HEADING_COLUMN, ELEVATIONS_DEG, HEIGHT_M = 120, 59.0, (-27.5, 90.0), 0.25
# Images this near to each other show the same, turned; the track's direction counts little against them, and only where it moves.
NEAR_M, ANCHOR, MOVING_M = 0.35, 0.02, 0.1
# The track of the queries was recorded in shares of a picture, and is at fault later on.
PICTURE_CM, LAST_QUERY_S = (240.0, 1290.0), 138.0
# Longer without a position, the robot was out of sight.
OUT_OF_SIGHT_S = 1.0


def main(words: Sequence[str] | None = None) -> int:
    """Convert; 2 if the recordings cannot be had or the folder cannot be written."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the data set, which must not exist")
    parser.add_argument("--source", type=Path, help="a checkout of the repository; fetched if left out")
    parser.add_argument("--every", type=int, default=1, metavar="K", help="every K-th reference only")
    parser.add_argument("--min-step", type=float, default=0.0, metavar="METRES", help="references at least so far apart")
    parser.add_argument("--scale", type=int, default=1, metavar="N", help="images enlarged N times")
    parser.add_argument("--bridged", action="store_true", help="true positions also while the robot was out of sight")
    arguments = parser.parse_args(words)
    try:
        if min(arguments.every, arguments.scale) < 1:
            raise ConfigError("--every and --scale: must be at least 1")
        with tempfile.TemporaryDirectory() as folder:
            source = arguments.source or _fetched(Path(folder))
            chosen = arguments.every, arguments.min_step, arguments.scale, arguments.bridged
            print(convert(source / "scripts", arguments.out, *chosen))
    except PanolocError as error:
        print("\n".join(f"error: {fault}" for fault in error.faults), file=sys.stderr)
        return 2
    return 0


def convert(source: Path, out: Path, every: int, min_step: float, scale: int, bridged: bool = False) -> Path:
    """Write the data set; ``source`` is the folder that holds robot_data and tracking_data."""
    times, names = _frames(source, "training")
    track = _smoothed(_track(source, "training_path_scaled"))
    positions = _at(track, times)
    directions, way = _directions(track, times)
    headings = visual_headings(np.stack([_grey(source, name) for name in names]), positions, directions, way)
    chosen = list(range(0, len(names), every))
    if min_step > 0.0:
        kept = chosen[:1]
        for index in chosen[1:]:
            if np.hypot(*(positions[index] - positions[kept[-1]])) >= min_step:
                kept.append(index)
        chosen = kept
    camera = camera_from_mapping(
        {
            "kind": "panorama",
            "columns": "counterclockwise",
            # Columns count from the middle of the first one, which is thinner in an enlarged image.
            "heading_column": (HEADING_COLUMN + 0.5) * scale - 0.5,
            "elevation_deg": list(ELEVATIONS_DEG),
            "height_m": HEIGHT_M,
        },
        "woodland",
    )
    writer = DatasetWriter(out, "woodland", camera, "real outdoor route, Knight et al. 2019", "none: for measurements only")
    poses = np.column_stack([positions, wrap_angle(headings)])[chosen]
    writer.add_references((_image(source, names[index], scale) for index in chosen), poses)
    times, names = _frames(source, "testing_infomax")
    used = times <= LAST_QUERY_S
    times, names = times[used], [name for name, use in zip(names, used, strict=True) if use]
    track = _track(source, "testing_path_infomax")
    # Shares of the picture, from its top; `_track` took them for centimetres.
    track[:, 1], track[:, 2] = PICTURE_CM[0] * track[:, 1], PICTURE_CM[1] * (0.01 - track[:, 2])
    track = _smoothed(track)
    truth = np.column_stack([_at(track, times), _directions(track, times)[0]])
    seen = np.ones(len(times), dtype=np.bool_) if bridged else _in_sight(track, times)
    images = (_image(source, name, scale) for name in names)
    writer.add_sequence("run1", times, images, groundtruth=Trajectory(times[seen], truth[seen]))
    return writer.finish()


def visual_headings(images: NDArray[np.float32], positions: Float64, directions: Float64, way: Float64) -> Float64:
    """Headings that make images (n, rows, columns) agree, with the track's directions (n,) as their mean; radians, not wrapped.

    The turn between two near images is the circular shift at which their rows correlate most; all of them together, and weakly the
    directions where the robot moved (``way``, metres), are met by least squares.
    """
    count, columns = len(images), images.shape[2]
    spectra = np.fft.fft(images - images.mean(axis=2, keepdims=True), axis=2)
    rows, places, factors, right = [], [], [], []
    for first in range(count):
        for second in [*range(first + 1, min(first + 8, count)), *([first + 15] if first + 15 < count else [])]:
            if np.hypot(*(positions[first] - positions[second])) >= NEAR_M:
                continue
            turns = np.fft.ifft(spectra[second] * np.conj(spectra[first]), axis=1).real.sum(axis=0)
            best = int(turns.argmax())
            before, here, after = turns[[best - 1, best, (best + 1) % columns]]
            bend = before - 2.0 * here + after
            shift = best + (0.5 * (before - after) / bend if bend < 0.0 else 0.0)
            rows += [len(right)] * 2
            places += [first, second]
            factors += [-1.0, 1.0]
            # Content moves to smaller columns when the heading grows.
            right.append(-2.0 * np.pi / columns * ((shift + columns / 2) % columns - columns / 2))
    unwrapped = np.unwrap(directions)
    for index in np.flatnonzero(way > MOVING_M):
        rows.append(len(right))
        places.append(int(index))
        factors.append(ANCHOR)
        right.append(ANCHOR * unwrapped[index])
    system = coo_matrix((factors, (rows, places)), shape=(len(right), count)).tocsr()
    return np.asarray(lsqr(system, np.array(right), atol=1e-10, btol=1e-10, iter_lim=5000)[0])


def _fetched(folder: Path) -> Path:
    checkout = folder / "woodland"
    try:
        subprocess.run(["git", "clone", "--quiet", "--depth", "1", REPOSITORY, str(checkout)], check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise ConfigError(f"{REPOSITORY}: cannot be fetched ({error}); check the network, or give --source CHECKOUT") from error
    return checkout


def _track(source: Path, name: str) -> Float64:
    """Seconds, and x and y as they are recorded, a hundredth each: float64 (n, 3)."""
    file = source / "tracking_data" / f"{name}.csv"
    if not file.is_file():
        raise ConfigError(f"{file}: no such file; --source must be a checkout of {REPOSITORY}")
    table = np.loadtxt(file, delimiter=",")
    return np.column_stack([table[:, 0] / 1e3, table[:, 1:] / 100.0])


def _frames(source: Path, name: str) -> tuple[Float64, list[str]]:
    with (source / "robot_data" / f"{name}.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))[1:]
    return np.array([float(row[0]) for row in rows]), [Path(row[-1].strip()).name for row in rows]


def _at(track: Float64, times: Float64) -> Float64:
    return np.column_stack([np.interp(times, track[:, 0], track[:, axis]) for axis in (1, 2)])


def _smoothed(track: Float64, sigma_s: float = 0.25) -> Float64:
    """Each stretch by itself: where the robot went while it was out of sight must not move where it was seen."""
    step = float(np.median(np.diff(track[:, 0])))
    stretches = np.split(track, np.flatnonzero(np.diff(track[:, 0]) > OUT_OF_SIGHT_S) + 1)
    smooth = [gaussian_filter1d(stretch[:, 1:], sigma_s / step, axis=0, mode="nearest") for stretch in stretches]
    return np.column_stack([track[:, 0], np.concatenate(smooth)])


def _in_sight(track: Float64, times: Float64) -> NDArray[np.bool_]:
    """Which times (n,) lie between two positions that follow on each other."""
    after = np.clip(np.searchsorted(track[:, 0], times), 1, len(track) - 1)
    return np.asarray(track[after, 0] - track[after - 1, 0] <= OUT_OF_SIGHT_S)


def _directions(track: Float64, times: Float64, half_s: float = 1.0) -> tuple[Float64, Float64]:
    """Direction of travel, radians, and the way that it is taken from, metres."""
    way = _at(track, times + half_s) - _at(track, times - half_s)
    return np.arctan2(way[:, 1], way[:, 0]), np.hypot(way[:, 0], way[:, 1])


def _grey(source: Path, name: str) -> NDArray[np.float32]:
    return np.asarray(cv2.imread(str(source / "robot_data" / name), cv2.IMREAD_GRAYSCALE), dtype=np.float32)


def _image(source: Path, name: str, scale: int) -> NDArray[np.uint8]:
    image = cv2.imread(str(source / "robot_data" / name))
    if image is None:
        raise ConfigError(f"{source / 'robot_data' / name}: cannot be read; check the checkout")
    if scale > 1:
        seam = 4
        wide = np.hstack([image[:, -seam:], image, image[:, :seam]])
        image = cv2.resize(wide, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)[:, seam * scale : -seam * scale]
    return np.asarray(image, dtype=np.uint8)


if __name__ == "__main__":
    sys.exit(main())
