"""Mending: poses of references that their images bear out, whatever the survey said.

Round by round: depths from the poses reached, relative poses of neighbours by refinement, a robust pose graph with the given poses
as priors (of a survey that drifts: the ways between them). References that no neighbour fits are looked for elsewhere, and placed anew
or left out. It ends when nothing moves.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.geometry import compose, wrap_angle
from panoloc_mcl.robot.map.keyframes import Edges, Keyframes, is_still
from panoloc_mcl.robot.map.mended import Mended, notes_of
from panoloc_mcl.robot.map.pairs import PairMeasurements, measure_pairs, neighbour_pairs
from panoloc_mcl.robot.map.pose_graph import Priors, Solution, closure_error, solve
from panoloc_mcl.robot.map.relocation import contradicted, relocated
from panoloc_mcl.robot.map.survey_frame import SurveyFrame, as_it_drifts, far_off_alone
from panoloc_mcl.robot.map.survey_scale import SurveyScale
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas, References, read_references
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import ViewSynthesizer, sweep_profiles
from panoloc_mcl.robot.synthesis.spacing import usual_spacing
from panoloc_mcl.robot.unfinished import Parts

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

_FEWEST = 4
# Farther apart than so many usual distances, two references show other things.
_FAR_IN_SPACINGS = 2.5
# A pair counts if its agreement is this share of the usual one: right pairs reach .8, images with nothing in common .2 to .4.
_LEAST_SHARE = 0.6
# What refinement errs by, however exact it claims to be: depths are those of a floor and a wall. Set on rendered references 1 m apart.
_LEAST_SD_M, _LEAST_SD_RAD = 0.003, np.radians(0.05)
# A weight from which on an edge supports its ends, and a given pose is borne out.
_SUPPORTS, _BORNE_OUT = 0.5, 0.1
# Relative poses that miss each other by more than this share of the way round a triangle cannot mend anything: walls and a floor do not
# describe the place, or its images are too coarse. Rendered halls and offices close to .01, images of a wood to .3.
_MOST_CLOSURE = 0.1
_NOT_CLOSED = "poses not mended: what images tell of relative poses here does not close round triangles"
# Nothing moves any more: keyframes moved less than that since the round before.
_STILL_M, _STILL_RAD = 0.003, np.radians(0.05)
# An image that is found this near to its given pose was never lost.
_SAME_POSE_M, _SAME_POSE_RAD = 0.3, np.radians(8.0)


def mend(
    source: References,
    votes: VotesSettings,
    settings: MapSettings,
    progress: Progress = no_progress,
    unfinished: Path | None = None,
) -> Mended:
    """Mend the poses of references.

    Parameters
    ----------
    source : References
    votes : VotesSettings
        How images are compared.
    settings : MapSettings
    progress : callable (done, total, what)
    unfinished : Path, optional
        A folder where what is done is kept, so that a build that was stopped goes on.

    Raises
    ------
    DatasetError, ImageError, OutputError
        As `read_references`; parts that cannot be kept.
    """
    panoramas = read_references(source, progress)
    names = panoramas.names
    if not settings.mend:
        return Mended(source, panoramas, Keyframes.surveyed(names, source.standpoints, source.sds), ())
    why_not = _why_not(panoramas)
    if why_not:
        return Mended(source, panoramas, Keyframes.surveyed(names, source.standpoints, source.sds), (why_not,))
    said = f"{votes.model_dump_json()} {settings.model_dump_json(exclude={'file'})}"
    parts = Parts(unfinished, "" if unfinished is None else panoramas.digest(said, source.poses, _given_sds(source, settings)))
    mending = _Mending(source, panoramas, votes, settings, progress, parts)
    # Read again in every round: these need not be kept beside the next ones.
    del panoramas
    return mending.run()


def _why_not(panoramas: ReferencePanoramas) -> str:
    if panoramas.camera_height_m is None:
        return "poses not mended: the camera's height is not known; give camera.height_m in dataset.yaml"
    if len(np.unique(panoramas.positions, axis=0)) < _FEWEST:
        return f"poses not mended: {len(panoramas)} references are too few to judge each other"
    return ""


class _Mending:
    """The state between rounds; arrays are over all references of the source."""

    def __init__(
        self,
        source: References,
        panoramas: ReferencePanoramas,
        votes: VotesSettings,
        settings: MapSettings,
        progress: Progress,
        parts: Parts,
    ) -> None:
        self.source, self.votes, self.settings, self.progress, self.parts = source, votes, settings, progress, parts
        self.panoramas = panoramas
        self.given = source.standpoints
        self.poses = self.given.copy()
        self.covariances = np.zeros((len(source), 3, 3))
        self.sds = _given_sds(source, settings)
        self.threads = votes.virtual_places.threads or os.cpu_count() or 1
        self.edges = Edges.none()
        self.metres = SurveyScale(1.0, np.inf)
        self.frame: SurveyFrame | None = None
        # References that were looked for elsewhere, found there, that no other fits, and that are in nobody's way.
        self.sought: set[int] = set()
        self.anew: set[int] = set()
        self.out: dict[int, str] = {}
        self.alone: set[int] = set()

    def run(self) -> Mended:
        """Round after round until nothing moves."""
        exact = False
        for number in range(self.settings.rounds):
            before = self.poses.copy()
            solution, synthesizer, sufficient = self._round(near=number > 0)
            if number == 0 and closure_error(self.edges) > self._most_closure(solution):
                return self._given(_NOT_CLOSED)
            lost = self._unsupported(solution)
            moved_anew = self._relocate(lost, synthesizer, sufficient)
            exact = self._is_exact(solution)
            self._take(solution, exact, moved_anew)
            if not moved_anew and (exact or is_still(before, self.poses, _STILL_M, _STILL_RAD)):
                break
            if number + 1 < self.settings.rounds:
                self.panoramas = read_references(self.source.moved_to(self.poses))
        if closure_error(self.edges) > _MOST_CLOSURE:
            return self._given(_NOT_CLOSED)
        self._judge_unfitting(lost, moved_anew)
        if not exact:
            self._place_frame()
        return self._result()

    def _most_closure(self, solution: Solution) -> float:
        """As `_MOST_CLOSURE`, in the first round: depths are swept from given poses, whose error is granted.

        That is what the survey says of itself, or else what the graph estimates.
        """
        sds = np.where(np.isnan(self.sds[:, 0]), solution.prior_sds[0], self.sds[:, 0])
        known = sds[np.isfinite(sds)]
        survey = math.sqrt(2.0) * float(np.median(known)) / usual_spacing(self.given[:, :2]) if len(known) else 0.0
        return math.hypot(_MOST_CLOSURE, survey)

    def _given(self, why: str) -> Mended:
        """Everything as it was."""
        keyframes = Keyframes.surveyed(self.panoramas.names, self.source.standpoints, self.source.sds)
        return Mended(self.source, self.panoramas, keyframes, (why,))

    def _round(self, near: bool) -> tuple[Solution, ViewSynthesizer, float]:
        """Depths, relative poses and the graph at the poses reached; also the agreement that is sufficient."""
        panoramas, progress = self.panoramas, self.progress
        height = panoramas.camera_height_m
        assert height is not None
        profiles = sweep_profiles(panoramas, height, self.votes, progress, self.threads, parts=self.parts)
        synthesizer = ViewSynthesizer(panoramas, profiles, height)
        pairs = neighbour_pairs(
            panoramas.positions, self.settings.neighbours, _FAR_IN_SPACINGS * usual_spacing(panoramas.positions)
        )
        apart = panoramas.positions[pairs[:, 1]] - panoramas.positions[pairs[:, 0]]
        starts = np.column_stack([apart, np.zeros(len(pairs))])
        measured = measure_pairs(synthesizer, pairs, starts, self.votes, near, progress, self.threads, self.parts)
        sufficient = _LEAST_SHARE * float(np.median(measured.agreement)) if len(pairs) else 1.0
        self.edges = robot_edges(measured, self.poses[:, 2], sufficient)
        priors = Priors(self.given, self.sds)
        solution = solve(self.poses, self.edges, priors)
        known = np.isfinite(solution.prior_weights) & ~np.isinf(self.sds).any(axis=1)
        self.metres = SurveyScale.of_edges(self.edges, solution.poses, self.given, np.where(known, solution.prior_weights, 0.0))
        if self.metres.is_off:
            # The survey is the frame: it is not stretched to what images make of a height that was measured wrongly.
            self.edges = self.metres.of_survey(self.edges)
            solution = solve(self.poses, self.edges, priors)
        solution, self.frame = as_it_drifts(solution, self.given, self._told(solution.poses))
        self.edges = solution.edges
        return solution, synthesizer, sufficient

    def _unsupported(self, solution: Solution) -> Int64:
        """References that no neighbour bears out, though there are some."""
        supports = solution.edges.weights >= _SUPPORTS
        supported = np.zeros(len(self.poses), dtype=np.bool_)
        supported[solution.edges.first[supports]] = True
        supported[solution.edges.second[supports]] = True
        return np.flatnonzero(~supported)

    def _relocate(self, lost: Int64, synthesizer: ViewSynthesizer, sufficient: float) -> set[int]:
        """Look for lost references elsewhere, each once; those found start the next round from there, with nothing given."""
        new = np.array([index for index in lost.tolist() if index not in self.sought], dtype=np.int64)
        # Where hardly anything fits anything, nobody can say who is lost.
        if not len(new) or len(lost) > 0.5 * len(self.poses):
            return set()
        self.sought.update(new.tolist())
        moved = set()
        found = relocated(synthesizer, new, self.votes, sufficient, self.progress, self.threads, self.parts)
        for index, pose in found.items():
            away = float(np.hypot(*(pose[:2] - self.poses[index, :2])))
            if away < _SAME_POSE_M and abs(pose[2]) < _SAME_POSE_RAD:
                # Where it was said to be, only hard to tell.
                continue
            self.poses[index] = [pose[0], pose[1], float(wrap_angle(self.poses[index, 2] + pose[2]))]
            moved.add(index)
        # Every lost one is looked for with the others lost, too; what was found is free of what was given.
        for index in moved:
            self.sds[index] = np.inf
            self.anew.add(index)
        return moved

    def _is_exact(self, solution: Solution) -> bool:
        """Whether given poses are better than a single measurement: then they are kept as they are."""
        usual = np.sqrt(np.median(np.einsum("mii->mi", solution.edges.covariances), axis=0)) * solution.scale
        estimated = np.isnan(self.sds).any(axis=1)
        return bool(
            len(solution.edges)
            and estimated.any()
            and solution.prior_sds[0] <= 0.5 * (usual[0] + usual[1])
            and solution.prior_sds[1] <= usual[2]
        )

    def _take(self, solution: Solution, exact: bool, moved_anew: set[int]) -> None:
        """Poses of the graph, or the given ones where these are exact."""
        keep = np.zeros(len(self.poses), dtype=np.bool_)
        keep[list(moved_anew)] = True
        if self.frame is None:
            # Where a survey drifts, ways from one reference to the next place those, too.
            keep[self._unsupported(solution)] = True
        if exact:
            given = np.isnan(self.sds).any(axis=1) & (solution.prior_weights >= _BORNE_OUT)
            self.poses[given] = self.given[given]
            keep |= given
        self.poses[~keep] = solution.poses[~keep]
        self.covariances = solution.covariances.copy()
        if exact:
            # As of a survey that is taken as it is: these poses are the frame, and held-out references tell what each errs by itself.
            self.covariances[given] = 0.0

    def _judge_unfitting(self, lost: Int64, moved_anew: set[int]) -> None:
        """References that fit nowhere: left out where others see that they are wrong; kept, but alone, where a wall may excuse them."""
        positions = self.poses[:, :2]
        for index in lost.tolist():
            if index in self.anew and index not in moved_anew:
                self.out[index] = "its image seemed to fit elsewhere, but no neighbour there bears it out"
            elif index in moved_anew:
                self.out[index] = "its image fits elsewhere, but rounds ended before its neighbours could bear it out"
            elif contradicted(positions, index, self.edges):
                self.out[index] = "its image fits neither its neighbours nor anywhere else"
            else:
                self.alone.add(index)

    def _told(self, poses: Float64) -> NDArray[np.bool_]:
        """Which poses were given, and are not far off alone."""
        known = ~np.isinf(self.sds).any(axis=1)
        return np.asarray(known & ~far_off_alone(self.given, poses, self.edges))

    def _place_frame(self) -> None:
        """Where the errors of given poses add up, the map keeps to where the survey began, not to its mean."""
        if self.frame is not None:
            self.frame = SurveyFrame.of_drift(self.given, self.poses, self._told(self.poses)) or self.frame
            self.poses = self.frame.moved(self.poses)
            self.covariances = self.frame.turned(self.covariances) + self.frame.errors_at(self.poses[:, :2])

    def _result(self) -> Mended:
        source, names = self.source, self.panoramas.names
        kept = np.setdiff1d(np.arange(len(source)), list(self.out))
        anew = [index for index in sorted(self.anew) if index not in self.out]
        keyframes = Keyframes(
            names,
            self.given,
            self.poses,
            self.covariances,
            np.full(len(source), np.nan),
            ("",) * len(source),
            self.edges,
            {names[index]: why for index, why in sorted(self.out.items())},
            tuple(names[index] for index in anew),
        ).of(kept)
        mended = source.moved_to(self.poses).of(kept)
        panoramas = read_references(mended)
        height = panoramas.camera_height_m
        metres = (self.metres.note(height),) if self.metres.is_off and height is not None else ()
        frame = () if self.frame is None else (self.frame.note,)
        return Mended(mended, panoramas, keyframes, (*notes_of(keyframes), *frame, *metres))


def robot_edges(measured: PairMeasurements, headings: Float64, sufficient: float) -> Edges:
    """Edges between robot poses, from relative poses of panoramas that were turned to heading 0 by the headings (n,) given.

    Pairs that agree too little are left out.
    """
    good = measured.agreement >= sufficient
    pairs, relative, covariances = measured.pairs[good], measured.relative[good], measured.covariances[good]
    first, second = headings[pairs[:, 0]], headings[pairs[:, 1]]
    turned = compose(np.column_stack([np.zeros((len(pairs), 2)), -first]), relative)
    turned[:, 2] = wrap_angle(turned[:, 2] + second)
    cos, sin = np.cos(first), np.sin(first)
    zero, one = np.zeros(len(pairs)), np.ones(len(pairs))
    rotation = np.moveaxis(np.array([[cos, sin, zero], [-sin, cos, zero], [zero, zero, one]]), 2, 0)
    least = np.diag([_LEAST_SD_M**2, _LEAST_SD_M**2, _LEAST_SD_RAD**2])
    return Edges.of(pairs, turned, rotation @ covariances @ np.swapaxes(rotation, 1, 2) + least)


def _given_sds(source: References, settings: MapSettings) -> Float64:
    """Standard deviations of given poses, from the table, the settings, or NaN: to be estimated."""
    sds = np.full((len(source), 2), np.nan)
    if settings.sd_xy_m is not None:
        sds[:, 0] = settings.sd_xy_m
    if settings.sd_theta_deg is not None:
        sds[:, 1] = np.radians(settings.sd_theta_deg)
    if source.sds is not None:
        sds = np.where(np.isnan(source.sds), sds, source.sds)
    return sds
