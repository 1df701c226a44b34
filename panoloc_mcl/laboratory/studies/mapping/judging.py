"""A map held against the truth: errors of its keyframes, and of images localized in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.geometry import FloatArray, angle_difference, between, compose, fitted_motion, wrap_angle
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.keyframes import LOOP, Keyframes
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.streams import answers, recorded

# A loop farther than this from the truth is false; with this weight it is believed.
_FALSE_M, _FALSE_RAD, _BELIEVED = 0.3, np.radians(10.0), 0.5
# A grossly wrong reference that the map holds farther than this from the truth was kept wrong.
_KEPT_WRONG_M, _KEPT_WRONG_DEG = 0.1, 3.0

Values = dict[str, Any]


def judged_keyframes(keyframes: Keyframes, dataset: Dataset, wrong: Sequence[int] = ()) -> tuple[Values, FloatArray]:
    """Errors of keyframes before and after mending.

    Parameters
    ----------
    keyframes : Keyframes
    dataset : Dataset
        With the true poses.
    wrong : sequence of int
        References that were given grossly wrong poses.

    Returns
    -------
    values : dict
        Plain values.
    frame : float64 (3,)
        The motion that brings the map's frame onto the true one.

    Raises
    ------
    DatasetError
        A drive without ground truth.
    """
    truth = _truth(keyframes, dataset)
    # A survey gives the frame, and later drives do not.
    held = np.array([not drive for drive in keyframes.drives])
    held = held if held.any() else np.ones(len(keyframes), dtype=np.bool_)
    frame = fitted_motion(keyframes.poses[held], truth[held])
    own = np.array([drive == keyframes.drives[0] for drive in keyframes.drives])
    given = keyframes.given[own]
    edges = keyframes.edges
    off = edges.measured - between(truth[edges.first], truth[edges.second])
    loops = edges.kinds == LOOP
    believed = loops & (edges.weights >= _BELIEVED)
    false = (np.hypot(off[:, 0], off[:, 1]) > _FALSE_M) | (np.abs(wrap_angle(off[:, 2])) > _FALSE_RAD)
    metres, degrees = _errors(keyframes.poses, truth, frame)
    is_wrong = dict(zip(keyframes.names, (metres > _KEPT_WRONG_M) | (degrees > _KEPT_WRONG_DEG), strict=True))
    names = {dataset.references.files[index].name for index in wrong}
    named = {*keyframes.placed_anew, *keyframes.left_out}
    return {
        "keyframes": len(keyframes),
        "way_m": float(np.hypot(*np.diff(truth[own][:, :2], axis=0).T).sum()),
        "given": _spread(*_errors(given, truth[own], fitted_motion(given, truth[own]))),
        "mended": _spread(metres, degrees),
        "unaligned": _spread(*_errors(keyframes.poses, truth, np.zeros(3))),
        "claimed": [float(value) for value in np.median(keyframes.sds, axis=0)],
        "wrong": len(names),
        "named": len(named & names),
        "blamed": len(named - names),
        "kept_wrong": sum(bool(is_wrong.get(name, False)) for name in names),
        "loops": int(loops.sum()),
        "loops_believed": int(believed.sum()),
        "loops_false": int((believed & false).sum()),
    }, frame


def localized(config: RunConfig, panorama_map: PanoramaMap, drive: Drive, every: int, frame: FloatArray) -> Values:
    """Errors over a drive, of single images and of the filter; infinite where an image says nothing, or the filter is not sure.

    Parameters
    ----------
    config : RunConfig
    panorama_map : PanoramaMap
    drive : Sequence
        With ground truth.
    every : int
        Use every so many images.
    frame : float64 (3,)
        The motion that brings the map's frame onto the true one.
    """
    some = drive.of(np.arange(min(every // 2, len(drive) - 1), len(drive), every))
    seed = (config.seed, *drive.name.encode())
    # What every image says by itself: it is not told where the robot is expected.
    searching = config.model_copy(update={"localizer": config.localizer.model_copy(update={"tracking": False})})
    localizer = Localizer(panorama_map, searching, camera=drive.camera, image_size=drive.image_size, seed=seed)
    assert drive.groundtruth is not None
    alone, filtered, truth = [], [], []
    for _, estimate in answers(localizer, recorded(some)):
        votes = estimate.vote_field
        said = None if votes is None or not votes.informative else votes.measurement
        alone.append(np.full(3, np.inf) if said is None else said.pose)
        filtered.append(estimate.pose if estimate.status is Status.CONVERGED else np.full(3, np.inf))
        truth.append(drive.groundtruth.at(estimate.timestamp))
    found = {}
    for name, poses in (("image", np.array(alone)), ("filter", np.array(filtered))):
        told = np.isfinite(poses).all(axis=1)
        metres, degrees, floating = (np.full(len(poses), np.inf) for _ in range(3))
        metres[told], degrees[told] = _errors(poses[told], np.array(truth)[told], frame)
        floating[told] = _errors(poses[told], np.array(truth)[told], np.zeros(3))[0]
        found[name] = {"m": metres.tolist(), "deg": degrees.tolist(), "unaligned_m": floating.tolist()}
    return found


def _truth(keyframes: Keyframes, dataset: Dataset) -> FloatArray:
    """True standpoints of the keyframes (n, 3)."""
    files = [file.name for file in dataset.references.files]
    surveyed = dataset.references.standpoints
    found = []
    for name, drive, when in zip(keyframes.names, keyframes.drives, keyframes.times, strict=True):
        if not drive:
            found.append(surveyed[files.index(name)])
            continue
        recorded_drive = dataset.sequences[drive]
        if recorded_drive.groundtruth is None:
            raise DatasetError(f"{recorded_drive.path}: has no ground truth; maps are judged by it")
        found.append(recorded_drive.camera.mounting.camera_poses(recorded_drive.groundtruth.at(when)[None])[0])
    return np.array(found)


def _errors(said: FloatArray, true: FloatArray, frame: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Metres and degrees, with the frame of the poses brought onto the true one."""
    moved = compose(frame, said)
    return np.hypot(*(moved - true)[:, :2].T), np.degrees(np.abs(angle_difference(moved[:, 2], true[:, 2])))


def _spread(metres: FloatArray, degrees: FloatArray) -> list[float]:
    """Median and largest, metres and degrees."""
    return [float(value) for value in (np.median(metres), metres.max(), np.median(degrees), degrees.max())]
