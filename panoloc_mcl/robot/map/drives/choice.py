"""Which images of a drive become keyframes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.map.drives.drive import Drive
from panoloc_mcl.robot.map.drives.likeness import Likeness
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import References, read_references
from panoloc_mcl.robot.settings.observation import VotesSettings

Int64 = NDArray[np.int64]

# Grey levels that an image varies by at the least, standard deviation: less is dark, covered or saturated.
_LEAST_SPREAD = 2.0


def keyframes_of(drive: Drive, votes: VotesSettings, distance_m: float, notes: list[str]) -> Drive:
    """Images some way apart, by odometry, or where that stands still by what they show.

    Parameters
    ----------
    drive : Drive
    votes : VotesSettings
        How images are compared.
    distance_m : float
    notes : list of str
        Gets a line where odometry stands still.
    """
    chosen, standing = chosen_keyframes(drive, distance_m), drive.stands()
    if not len(standing):
        return drive.of(chosen)
    looked_at = np.union1d(chosen, standing)
    some = drive.of(looked_at)
    likeness = Likeness(read_references(references_of(some)), votes)
    new = looked_at[missed(likeness, np.searchsorted(looked_at, chosen), np.searchsorted(looked_at, standing))]
    if len(new):
        notes.append(
            f"drive {drive.name}: odometry stands still while images change, first at {drive.times[new[0]]:.3f} s; {len(new)} more "
            "images became keyframes, and images bridge the way"
        )
    return replace(drive, doubted=frozenset(new.tolist())).of(np.union1d(chosen, new))


def chosen_keyframes(drive: Drive, distance_m: float) -> Int64:
    """Images of a drive some way apart: turning on the spot shows a panoramic camera nothing new."""
    kept: list[int] = []
    for index, pose in enumerate(drive.odometry):
        if not kept or np.hypot(*(pose - drive.odometry[kept[-1]])[:2]) >= distance_m:
            kept.append(index)
    return np.array(kept, dtype=np.int64)


def missed(likeness: Likeness, chosen: Int64, standing: Int64) -> Int64:
    """Images that show something new though odometry stands still: less like the last one kept than keyframes one after the other.

    Parameters
    ----------
    likeness : Likeness
        Of all images of a drive.
    chosen, standing : int64
        Keyframes, and images before which odometry did not move (ascending).
    """

    def alike(first: int, second: int) -> float:
        return float(likeness.turns(second, np.array([first])).max())

    usual = float(np.median([alike(a, b) for a, b in zip(chosen[:-1].tolist(), chosen[1:].tolist(), strict=True)]))
    found: list[int] = []
    for index in np.setdiff1d(standing, chosen).tolist():
        last = max(int(chosen[np.searchsorted(chosen, index) - 1]), found[-1] if found else 0)
        if alike(last, index) < usual:
            found.append(index)
    return np.array(found, dtype=np.int64)


def that_show_something(drive: Drive, notes: list[str], progress: Progress = no_progress) -> Drive:
    """The drive without images that are dark, covered or saturated.

    Parameters
    ----------
    drive : Drive
    notes : list of str
        Gets a line where there are some.
    progress : callable (done, total, what)
    """
    panoramas = read_references(references_of(drive), progress)
    seen = np.array([pixels.astype(np.float32).std() > _LEAST_SPREAD for pixels in panoramas.pixels])
    if seen.all():
        return drive
    notes.append(
        f"drive {drive.name}: {np.sum(~seen)} of {len(drive.files)} keyframes show nothing (dark, covered or saturated) and are "
        "left out"
    )
    return drive.of(np.flatnonzero(seen))


def references_of(drive: Drive) -> References:
    """The images of a drive as those of known places, with the poses that odometry gives."""
    return References(Path(drive.name), drive.files, drive.odometry, drive.camera, drive.image_size)
