"""A map from drives: keyframes along the way, relative poses of those one after the other, loops, and a pose graph over all.

It reads as the algorithm: depths from neighbours along the way, where odometry is good; measured steps; loops that images and odometry
bear out; then the same as with references, among all that are near, until nothing moves.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.geometry import between, wrap_angle
from panoloc_mcl.robot.map.drives.choice import keyframes_of, references_of, that_show_something
from panoloc_mcl.robot.map.drives.common_errors import common_errors
from panoloc_mcl.robot.map.drives.drift import straightened
from panoloc_mcl.robot.map.drives.drive import Drive, check_drives
from panoloc_mcl.robot.map.drives.likeness import Likeness
from panoloc_mcl.robot.map.drives.loops import proposed, verified
from panoloc_mcl.robot.map.drives.meetings import meeting
from panoloc_mcl.robot.map.keyframes import BELIEVED, LOOP, ODOMETRY, Edges, Keyframes, is_still
from panoloc_mcl.robot.map.mended import Mended
from panoloc_mcl.robot.map.mending import robot_edges
from panoloc_mcl.robot.map.own_body import with_found_mask
from panoloc_mcl.robot.map.pairs import measure_pairs, neighbour_pairs
from panoloc_mcl.robot.map.pose_graph import Priors, solve
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas, References, read_references
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, sweep_profiles
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

# Along the way, every keyframe is measured against so many before and after it.
_ALONG = 2
# Depths judged by odometry's headings keep some of its drift; the second time there is little left of it.
_ROUNDS_ALONG = 2
# Farther apart than this, two keyframes of a drive show other things.
_FARTHEST_M = 1.5
# Keyframes this many apart along the way are not one after the other.
_LOOP_AFTER = 6
# What steps measured by images err by, beside what odometry does: so far may two poses be off each other after a way.
_GATE_M, _GATE_PER_M = 0.8, 0.02
_GATE_RAD, _GATE_RAD_PER_M, _WIDEST_RAD = np.radians(12.0), np.radians(0.5), np.radians(50.0)
_LEAST_SHARE = 0.6
# Farther than any drive leads.
_FAR_M = 1e6
_STILL_M, _STILL_RAD = 0.004, np.radians(0.05)


def map_drives(
    drives: Sequence[Drive],
    votes: VotesSettings,
    settings: MapSettings,
    progress: Progress = no_progress,
    unfinished: Path | None = None,
) -> Mended:
    """Keyframes of drives with poses in one frame, that of the first drive's odometry at its first keyframe.

    Parameters
    ----------
    drives : sequence of Drive
        All of one camera.
    votes : VotesSettings
        How images are compared.
    settings : MapSettings
    progress : callable (done, total, what)
    unfinished : Path, optional
        A folder where what is done is kept, so that a build that was stopped goes on.

    Raises
    ------
    MapError, ImageError, OutputError
        Drives that no map can be made of; images that cannot be read; parts that cannot be kept.
    """
    notes = list(check_drives(drives))
    if settings.find_body:
        drives = _without_body(drives, notes)
    chosen = [keyframes_of(drive, votes, settings.keyframe_distance_m, notes) for drive in drives]
    return _Mapping(chosen, votes, settings, progress, notes, unfinished).run()


def _without_body(drives: Sequence[Drive], notes: list[str]) -> list[Drive]:
    """The drives with the robot left out of their camera's sight, where it is found in their images."""
    files = [file for drive in drives for file in drive.files]
    # Poses of one drive say nothing of those of another.
    poses = [drive.odometry + np.array([_FAR_M * number, 0.0, 0.0]) for number, drive in enumerate(drives)]
    camera, note = with_found_mask(drives[0].camera, drives[0].image_size, files, np.concatenate(poses))
    notes += note
    return [replace(drive, camera=camera) for drive in drives]


class _Mapping:
    """The state between rounds; arrays are over all keyframes, drive after drive."""

    def __init__(
        self,
        drives: list[Drive],
        votes: VotesSettings,
        settings: MapSettings,
        progress: Progress,
        notes: list[str],
        unfinished: Path | None,
    ) -> None:
        self.votes, self.settings, self.progress, self.notes = votes, settings, progress, notes
        self.threads = votes.virtual_places.threads or os.cpu_count() or 1
        self._read(drives)
        self.edges = self.solved = Edges.none()
        self.covariances = np.zeros((len(self.poses), 3, 3))
        # Headings by which the panoramas at hand were turned to 0.
        self._turned: Float64 = self.poses[:, 2].copy()
        said = f"{votes.model_dump_json()} {settings.model_dump_json(exclude={'file'})}"
        odometry = self.odometry.measured, self.odometry.covariances, self.owner
        self.parts = Parts(unfinished, "" if unfinished is None else self._panoramas().digest(said, self.given, *odometry))

    def _read(self, drives: list[Drive]) -> None:
        kept = [seen for drive in drives if len((seen := that_show_something(drive, self.notes, self.progress)).files) >= 2]
        if not kept:
            raise MapError("drives: no image shows anything; a map needs light")
        self.drives = kept
        self.starts = np.concatenate([[0], np.cumsum([len(drive.files) for drive in kept])])
        self.owner = np.repeat(np.arange(len(kept)), np.diff(self.starts))
        mounting = kept[0].camera.mounting
        self.given = np.concatenate([mounting.camera_poses(drive.odometry) for drive in kept])
        straight = [straightened(drive, self.votes, self.notes) for drive in kept]
        self.poses = np.concatenate([mounting.camera_poses(drive.odometry) for drive in straight])
        self.odometry = Edges.none()
        for start, drive in zip(self.starts, straight, strict=False):
            self.odometry = self.odometry.joined(drive.at(mounting.camera_poses(drive.odometry)).edges(int(start)))
        #: Drives that are in the map's frame already; the others wait until they meet.
        self.anchored = [0]

    def run(self) -> Mended:
        """Along the way, loops, and rounds among all that are near."""
        synthesizer, sufficient = self._along_the_way()
        if self._meet(synthesizer, sufficient):
            synthesizer = self._synthesizer(None)
        self._close_loops(synthesizer, sufficient)
        for _ in range(max(1, self.settings.rounds - 2)):
            before = self.poses.copy()
            self._among_the_near()
            if is_still(before, self.poses, _STILL_M, _STILL_RAD):
                break
        return self._result()

    def _along_the_way(self) -> tuple[ViewSynthesizer, float]:
        """Depths and relative poses from keyframes before and after, again from the poses that these give."""
        pairs = self._pairs_along()
        neighbours = [pairs[pairs[:, 1] == index, 0].tolist() for index in range(len(self.poses))]
        for number in range(_ROUNDS_ALONG):
            self.panoramas = self._panoramas()
            synthesizer = self._synthesizer(neighbours)
            self.edges, sufficient = self._measured(synthesizer, pairs, near=number > 0)
            self._solve()
        return synthesizer, sufficient

    def _pairs_along(self) -> Int64:
        pairs = [
            (i, j)
            for start, end in zip(self.starts[:-1], self.starts[1:], strict=True)
            for i in range(start, end)
            for j in range(max(start, i - _ALONG), min(end, i + _ALONG + 1))
            if i != j and np.hypot(*(self.given[i] - self.given[j])[:2]) <= _FARTHEST_M
        ]
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    def _meet(self, synthesizer: ViewSynthesizer, sufficient: float) -> bool:
        """Bring every further drive into the frame of those that are there, where images of both agree; whether any never does."""
        if len(self.drives) == 1:
            return False
        likeness = Likeness(self.panoramas, self.votes)
        waiting = list(range(1, len(self.drives)))
        while waiting:
            for drive in waiting:
                theirs = np.flatnonzero(np.isin(self.owner, self.anchored))
                mine = np.flatnonzero(self.owner == drive)
                known = synthesizer, likeness, self.poses, self._turned
                found = meeting(*known, theirs, mine, self.votes, sufficient, self.threads, self.parts)
                if found is not None:
                    self.poses[mine] = found
                    self.anchored.append(drive)
                    waiting.remove(drive)
                    break
            else:
                break
        if waiting:
            names = ", ".join(self.drives[drive].name for drive in waiting)
            self.notes.append(
                f"drives that never meet the others are left out: {names}; make a map of each, or drive a way between"
            )
            kept = np.flatnonzero(np.isin(self.owner, self.anchored))
            self._keep(kept, sorted(self.anchored))
            self.panoramas, self._turned = self.panoramas.of(kept), self._turned[kept]
            self.anchored = list(range(len(self.drives)))
            self._solve()
        return bool(waiting)

    def _keep(self, kept: Int64, drives: list[int]) -> None:
        """Go on with some keyframes (whole drives) only."""
        self.edges, self.odometry = self.edges.among(kept), self.odometry.among(kept)
        self.poses, self.given, self.owner = self.poses[kept], self.given[kept], self.owner[kept]
        self.drives = [self.drives[drive] for drive in drives]
        self.owner = np.searchsorted(drives, self.owner)
        self.starts = np.concatenate([[0], np.cumsum([len(drive.files) for drive in self.drives])])

    def _close_loops(self, synthesizer: ViewSynthesizer, sufficient: float) -> None:
        """Loops within drives and between them, twice: what the first ones pull straight brings others within reach."""
        likeness = Likeness(self.panoramas, self.votes)
        for _ in range(2):
            way = self._way_between()
            apart = (np.abs(np.subtract.outer(np.arange(len(self.poses)), np.arange(len(self.poses)))) >= _LOOP_AFTER) | (
                self.owner[:, None] != self.owner[None]
            )
            pairs, turns = proposed(
                likeness,
                self.poses,
                self._turned,
                _GATE_M + _GATE_PER_M * way,
                np.minimum(_GATE_RAD + _GATE_RAD_PER_M * way, _WIDEST_RAD),
                apart,
            )
            made = self.votes, sufficient, self.progress, self.threads, self.parts
            loops = verified(synthesizer, pairs, turns, self._turned, *made)
            self.edges = self.edges.chosen(self.edges.kinds != LOOP).joined(loops)
            before = self.poses.copy()
            self._solve()
            if not len(loops) or is_still(before, self.poses, _STILL_M, _STILL_RAD):
                break

    def _way_between(self) -> Float64:
        """Metres driven between any two keyframes of a drive; between drives, as far as their meeting is sure."""
        step = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        step[self.starts[1:-1] - 1] = 0.0
        along = np.concatenate([[0.0], np.cumsum(step)])
        return np.where(self.owner[:, None] == self.owner[None], np.abs(np.subtract.outer(along, along)), 20.0)

    def _among_the_near(self) -> None:
        """Depths and relative poses among all keyframes that are near each other."""
        self.panoramas = self._panoramas()
        pairs = neighbour_pairs(self.panoramas.positions, self.settings.neighbours, _FARTHEST_M)
        pairs = np.unique(np.concatenate([pairs, self._pairs_along()]), axis=0)
        synthesizer = self._synthesizer(self._believed_neighbours())
        edges, _ = self._measured(synthesizer, pairs, near=True)
        along = np.abs(edges.first - edges.second) < _LOOP_AFTER
        loops = np.where(along & (self.owner[edges.first] == self.owner[edges.second]), edges.kinds, LOOP)
        self.edges = replace(edges, kinds=loops)
        self._solve()

    def _believed_neighbours(self) -> list[list[int]]:
        """Of every keyframe, those nearest that an edge joins it to: depth is not judged by one that may lie elsewhere."""
        believed = self.edges.chosen(self.edges.weights >= BELIEVED)
        wanted = self.votes.virtual_places.neighbours
        found = []
        for index in range(len(self.poses)):
            joined = np.unique(
                np.concatenate([believed.first[believed.second == index], believed.second[believed.first == index]])
            )
            # What lies nearly at the same place shows no depth.
            away = np.hypot(*(self.poses[joined] - self.poses[index])[:, :2].T)
            joined, away = joined[away > 0.1], away[away > 0.1]
            found.append(joined[np.argsort(away, kind="stable")][:wanted].tolist())
        return found

    def _solve(self) -> None:
        sds = np.full((len(self.poses), 2), np.inf)
        # The frame: the first keyframe of the first drive stays; drives that have not met yet stay where odometry has them.
        for drive in range(len(self.drives)):
            if drive == 0 or drive not in self.anchored:
                sds[self.starts[drive]] = 1e-4
        edges, priors = self.odometry.joined(self.edges), Priors(self.poses.copy(), sds, robust=False)
        solution = solve(self.poses, edges, priors, common=common_errors(edges, self.poses, self.owner))
        self.poses, self.covariances, self.solved = solution.poses, solution.covariances, solution.edges
        self.edges = self.solved.chosen(self.solved.kinds != ODOMETRY)

    def _panoramas(self) -> ReferencePanoramas:
        self._turned = self.poses[:, 2].copy()
        return read_references(self._whole().moved_to(self.poses), self.progress)

    def _measured(self, synthesizer: ViewSynthesizer, pairs: Int64, near: bool) -> tuple[Edges, float]:
        """Edges of pairs that agree, and the agreement that is sufficient."""
        panorama = np.column_stack([self.poses[:, :2], wrap_angle(self.poses[:, 2] - self._turned)])
        starts = between(panorama[pairs[:, 0]], panorama[pairs[:, 1]])
        measured = measure_pairs(synthesizer, pairs, starts, self.votes, near, self.progress, self.threads, self.parts)
        sufficient = _LEAST_SHARE * float(np.median(measured.agreement))
        return robot_edges(measured, self._turned, sufficient), sufficient

    def _synthesizer(self, neighbours: list[list[int]] | None) -> ViewSynthesizer:
        references = replace(self.panoramas, positions=np.ascontiguousarray(self.poses[:, :2]))
        assert references.camera_height_m is not None
        made = self.votes, self.progress, self.threads, neighbours, self.parts
        profiles = sweep_profiles(references, references.camera_height_m, *made)
        return ViewSynthesizer(references, profiles, references.camera_height_m)

    def _whole(self) -> References:
        files = tuple(file for drive in self.drives for file in drive.files)
        return replace(references_of(self.drives[0]), files=files, poses=self.poses)

    def _result(self) -> Mended:
        names = tuple(f"{drive.name}/{file.name}" for drive in self.drives for file in drive.files)
        keyframes = Keyframes(
            names,
            self.given,
            self.poses,
            self.covariances,
            np.concatenate([drive.times for drive in self.drives]),
            tuple(drive.name for drive in self.drives for _ in drive.files),
            self.solved,
        )
        source = self._whole().moved_to(self.poses)
        panoramas = replace(read_references(source, self.progress), names=names)
        return Mended(source, panoramas, keyframes, (*self.notes, *_summary(keyframes)))


def _summary(keyframes: Keyframes) -> Iterator[str]:
    edges = keyframes.edges
    loops = edges.kinds == LOOP
    believed = int(np.sum(edges.weights[loops] >= 0.5))
    way = float(np.hypot(*np.diff(keyframes.poses[:, :2], axis=0).T).sum())
    yield (
        f"{len(keyframes)} keyframes over {way:.0f} m, {len(edges)} relative poses, {believed} of {int(loops.sum())} between keyframes "
        f"that met again are borne out"
    )
    borne_out = edges.chosen((edges.kinds != ODOMETRY) & (edges.weights >= BELIEVED))
    alone = np.setdiff1d(np.arange(len(keyframes)), np.concatenate([borne_out.first, borne_out.second]))
    if len(alone):
        yield f"{len(alone)} keyframes fit no other, first {keyframes.names[alone[0]]}: only odometry says where; they count less"
    if believed == 0:
        yield "the drive closes no loop: the map is as straight as its steps are; drive over a place again to close one"
