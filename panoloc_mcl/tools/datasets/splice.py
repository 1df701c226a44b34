"""Carrying the robot away: sequences are cut into pieces and spliced, odometry silent at every joint."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.images import ImageSource
from panoloc_mcl.tools.datasets.dataset import Sequence
from panoloc_mcl.tools.datasets.trajectory import Trajectory
from panoloc_mcl.tools.evaluation.record import group_of

Float64 = NDArray[np.float64]


def splice(sequences: list[Sequence], every_frames: int, rng: np.random.Generator) -> list[tuple[Sequence, NDArray[np.bool_]]]:
    """One long sequence for each group, in which the robot is teleported every so many frames.

    Every sequence is cut into pieces of ``every_frames`` frames (a shorter rest is left out, but a sequence shorter than that is
    kept whole), and the pieces of a group are put together in random order, no piece behind the one that it really follows. Time
    goes on by one frame period at a joint, and odometry stands still there.

    Parameters
    ----------
    sequences : list of Sequence
    every_frames : int
        At least 1.
    rng : numpy.random.Generator

    Returns
    -------
    list of (Sequence, bool (n,))
        The spliced sequences, and which frames are the first after a teleport.

    Raises
    ------
    DatasetError
        Sequences of one group have different cameras, or some have odometry or ground truth and others not.
    """
    groups: dict[str, list[Sequence]] = defaultdict(list)
    for sequence in sequences:
        groups[group_of(sequence.name)].append(sequence)
    return [_spliced(name, members, every_frames, rng) for name, members in groups.items()]


def teleports_of(kidnapped: NDArray[np.bool_], frames: ArrayLike) -> NDArray[np.bool_]:
    """Teleports of a part of the frames: one at a frame that is left out counts at the next that is not.

    Parameters
    ----------
    kidnapped : bool (n,)
    frames : array_like of int (m,)
        Ascending indices of the frames that are left, m >= 1.

    Returns
    -------
    bool (m,)
    """
    upto = np.concatenate([[0], np.cumsum(kidnapped)])[np.asarray(frames, dtype=np.int64) + 1]
    return np.concatenate([[False], np.diff(upto) > 0])


def _spliced(
    name: str, members: list[Sequence], every_frames: int, rng: np.random.Generator
) -> tuple[Sequence, NDArray[np.bool_]]:
    first = members[0]
    for other in members[1:]:
        for what, differs in (
            ("another camera", other.camera != first.camera or other.image_size != first.image_size),
            ("odometry where the other has none", (other.odometry is None) != (first.odometry is None)),
            ("ground truth where the other has none", (other.groundtruth is None) != (first.groundtruth is None)),
        ):
            if differs:
                raise DatasetError(
                    f"kidnap.every_frames = {every_frames}: '{other.name}' and '{first.name}' cannot be spliced, one has {what}; "
                    "select sequences that agree"
                )
    pieces = _shuffled([piece for member in members for piece in _pieces(member, every_frames)], rng)
    files: list[ImageSource] = []
    times, odometry, truth, kidnapped = [], [], [], []
    clock = 0.0
    standing = np.zeros(3)
    for number, (member, start, end) in enumerate(pieces):
        period = float(np.median(np.diff(member.times))) if len(member) > 1 else 1.0
        begin = float(member.times[start])
        shift = clock - begin if number else 0.0
        stamps = member.times[start:end] + shift
        times.append(stamps)
        files.extend(member.files[start:end])
        kidnapped.extend([number > 0] + [False] * (end - start - 1))
        if member.odometry is not None:
            stretch = _odometry_between(member.odometry, begin, float(member.times[end - 1]))
            poses = compose(standing, between(stretch.poses[0], stretch.poses))
            odometry.append((stretch.times + shift, poses))
            standing = poses[-1]
        if member.groundtruth is not None:
            truth.append(member.groundtruth.at(member.times[start:end]))
        clock = float(stamps[-1]) + period
    all_times = np.concatenate(times)
    spliced = replace(
        first,
        name=f"{name}_spliced",
        times=all_times,
        files=tuple(files),
        odometry=Trajectory(np.concatenate([t for t, _ in odometry]), np.concatenate([p for _, p in odometry]))
        if odometry
        else None,
        groundtruth=Trajectory(all_times, np.concatenate(truth)) if truth else None,
    )
    return spliced, np.array(kidnapped)


def _pieces(sequence: Sequence, every_frames: int) -> list[tuple[Sequence, int, int]]:
    if len(sequence) < every_frames:
        return [(sequence, 0, len(sequence))]
    return [(sequence, k, k + every_frames) for k in range(0, len(sequence) - every_frames + 1, every_frames)]


def _shuffled(pieces: list[tuple[Sequence, int, int]], rng: np.random.Generator) -> list[tuple[Sequence, int, int]]:
    remaining = [pieces[i] for i in rng.permutation(len(pieces))]
    ordered = [remaining.pop(0)]
    while remaining:
        choices = [i for i, piece in enumerate(remaining) if not _follows(ordered[-1], piece)]
        if choices:
            ordered.append(remaining.pop(choices[0]))
            continue
        # Only the piece that really follows is left: it goes where it neither follows nor is followed by its neighbour.
        last = remaining.pop(0)
        free = (i for i in range(len(ordered)) if not (i and _follows(ordered[i - 1], last)) and not _follows(last, ordered[i]))
        ordered.insert(next(free, len(ordered)), last)
    return ordered


def _follows(before: tuple[Sequence, int, int], after: tuple[Sequence, int, int]) -> bool:
    return after[0] is before[0] and after[1] == before[2]


def _odometry_between(odometry: Trajectory, begin: float, end: float) -> Trajectory:
    """Odometry from one time to another, with poses at exactly both, so that pieces join without a gap."""
    inside = (odometry.times > begin) & (odometry.times < end)
    times = np.concatenate([[begin], odometry.times[inside], [end]] if end > begin else [[begin]])
    return Trajectory(times, odometry.at(times))
