"""The turn that creeps into odometry with the way, taken out by what neighbouring images show.

Depth cannot tell such a turn apart from walls that stand a little nearer on one side: views made with it fit each other, and relative
poses measured on them keep the turn. Only floor, and what lies ahead and behind, contradict it. So depths are swept for several turns,
and the one is taken at which they fit best.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import between, compose, wrap_angle
from panoloc_mcl.robot.map.drives.choice import references_of
from panoloc_mcl.robot.map.drives.drive import Drive
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis.depth import core_rows, fit_of_depths, with_rows
from panoloc_mcl.robot.synthesis.views import ViewSynthesizer

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Turns that are tried, degrees a metre, evenly.
_TRIED = np.linspace(-3.0, 3.0, 7)
# Keyframes that are looked at, each between the one before and the one after it.
_MOST, _FEWEST = 16, 4
# Steps that turn by more tell nothing of what creeps in.
_LARGEST_TURN = np.radians(25.0)
# A turn is taken out where images fit better without it by so many standard errors.
_CLEAR = 2.0


def straightened(drive: Drive, votes: VotesSettings, notes: list[str]) -> Drive:
    """The drive with odometry that the turn has been taken out of.

    Parameters
    ----------
    drive : Drive
        Keyframes only.
    votes : VotesSettings
        How images are compared.
    notes : list of str
        Gets a line where there was one.
    """
    drift = drift_of(drive, votes)
    if drift == 0.0:
        return drive
    notes.append(f"drive {drive.name}: odometry turns by {np.degrees(drift):+.2f} degrees a metre; taken out")
    return without(drive, drift)


def drift_of(drive: Drive, votes: VotesSettings) -> float:
    """Radians that odometry turns too far with every metre; 0 where images do not say clearly.

    Parameters
    ----------
    drive : Drive
        Keyframes only.
    votes : VotesSettings
        How images are compared.
    """
    middles = _middles(drive)
    if len(middles) < _FEWEST:
        return 0.0
    middles = middles[np.unique(np.linspace(0, len(middles) - 1, min(_MOST, len(middles))).round().astype(np.int64))]
    fits = np.array([_fits(without(drive, np.radians(turn)), middles, votes) for turn in _TRIED])
    total = fits.mean(axis=1)
    best = int(np.argmax(total))
    zero = len(_TRIED) // 2
    gain = fits[best] - fits[zero]
    clear = gain.mean() > _CLEAR * gain.std(ddof=1) / np.sqrt(len(gain))
    if not clear or best in (0, len(_TRIED) - 1):
        return 0.0
    before, here, after = total[best - 1 : best + 2]
    offset = 0.5 * (before - after) / (before - 2.0 * here + after)
    return float(np.radians(_TRIED[best] + offset * (_TRIED[1] - _TRIED[0])))


def without(drive: Drive, radians_a_metre: float) -> Drive:
    """The drive with odometry that turns less far by this."""
    steps = between(drive.odometry[:-1], drive.odometry[1:])
    steps[:, 2] = wrap_angle(steps[:, 2] - radians_a_metre * np.hypot(steps[:, 0], steps[:, 1]))
    path = [drive.odometry[0]]
    for step in steps:
        path.append(compose(path[-1], step))
    return drive.at(np.array(path))


def _middles(drive: Drive) -> Int64:
    """Keyframes between two steps that odometry knows and that hardly turn."""
    turns = np.abs(between(drive.odometry[:-1], drive.odometry[1:])[:, 2])
    good = (turns < _LARGEST_TURN) & ~drive.unknown()
    return 1 + np.flatnonzero(good[:-1] & good[1:])


def _fits(drive: Drive, middles: Int64, votes: VotesSettings) -> Float64:
    """How well keyframes fit those before and after them, with the depths at which they fit best."""
    looked_at = np.unique(np.concatenate([middles - 1, middles, middles + 1]))
    panoramas = read_references(references_of(drive.of(looked_at)))
    panoramas = with_rows(panoramas, core_rows(panoramas.geometry))
    assert panoramas.camera_height_m is not None
    synthesizer = ViewSynthesizer(panoramas, np.ones((len(panoramas), panoramas.geometry.width)), panoramas.camera_height_m)
    places = np.searchsorted(looked_at, middles)
    return np.array([fit_of_depths(int(place), [int(place) - 1, int(place) + 1], synthesizer, votes) for place in places])
