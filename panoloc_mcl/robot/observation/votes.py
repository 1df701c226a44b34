"""The default model: all headings at once in an eigenspace of locally normalised gradients.

The cosine between the image's and a place's coefficients (eq. 4 of the paper) is worked out for all headings and places at once
(`correlator`). Its norms are those of the overlap of both images' usable pixels, so what is masked in either does not count, and the
cosine becomes a vote by the paper's voting function (eq. 3).
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.eigenspace.gradients import check_filter_size, orientations, quiet, useless
from panoloc_mcl.robot.observation.base import Arrays
from panoloc_mcl.robot.observation.calibration import DIM, Calibration, calibrate
from panoloc_mcl.robot.observation.correlator import Correlator, OfPlace
from panoloc_mcl.robot.observation.eigenviews import correlator_of
from panoloc_mcl.robot.observation.field import VoteField, at_headings, silent_field, vote_of_cosine
from panoloc_mcl.robot.observation.large_maps.asked import MOST_DENSE, Asked
from panoloc_mcl.robot.observation.large_maps.retrieval import Retrieval, learned_count
from panoloc_mcl.robot.observation.overlap import block_energy, block_usable
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.observation.scale import at_resolution, references_at, resolution_of
from panoloc_mcl.robot.observation.sources import check_texture, places_between, sources_of
from panoloc_mcl.robot.observation.tracking import Expected
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.robot.synthesis import (
    PoseRefiner,
    SourceErrors,
    ViewSynthesizer,
    learn_source_errors,
    synthetic_features,
)
from panoloc_mcl.robot.unfinished import Parts

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Complex64 = NDArray[np.complex64]

# What votes at the true pose fall short of the best ones, where it was not learnt; and at the least: few references teach no trust.
_USUAL_TOLERANCE, _LEAST_TOLERANCE = 0.15, 0.08
# Confidence that is proof enough where the pose was expected anyhow.
_SURE = 0.9


class VotesModel:
    """Votes over all headings and places of the map (model ``votes``).

    Parameters
    ----------
    places : Places
    settings : VotesSettings
    correlator : Correlator
        What an image is compared with.
    kept : float
        Share of the places' energy that the eigenimages hold.
    synthesizer : ViewSynthesizer, optional
        That made the views of virtual places; without one, the places are the references.
    notes : tuple of str
        What the user should know of the map.
    calibration : Calibration, optional
        What held-out references taught; without one, no confidence is given.
    used : int64 (m,), optional
        References that the model is made from: those that tell something new and are not doubted. All, by default.
    retrieved : int, optional
        Of a large map, how many places are voted on; None: all.

    Attributes
    ----------
    retrieval : Retrieval or None
        What chooses these.
    """

    name = "votes"
    draws = False
    gives_heading = True

    def __init__(
        self,
        places: Places,
        settings: VotesSettings,
        correlator: Correlator,
        kept: float,
        synthesizer: ViewSynthesizer | None = None,
        notes: tuple[str, ...] = (),
        calibration: Calibration | None = None,
        used: NDArray[np.int64] | None = None,
        retrieved: int | None = None,
    ) -> None:
        self.places = places
        self.settings = settings
        self.kept = kept
        self.notes = notes
        self.calibration = calibration
        self._used = used
        self._correlator = correlator
        self.retrieval = None if retrieved is None else Retrieval(correlator, places, retrieved)
        self._shape = correlator.real.shape[1], correlator.columns
        self._headings = _around_the_circle(correlator.columns)
        self._synthesizer = synthesizer
        refines = synthesizer is not None and settings.refinement.enabled
        self._refiner = PoseRefiner(synthesizer, settings) if synthesizer is not None and refines else None

    @classmethod
    def build(
        cls,
        references: ReferencePanoramas,
        settings: VotesSettings,
        seed: int = 0,
        progress: Progress = no_progress,
        unfinished: Path | None = None,
    ) -> Self:
        """Compute depths, virtual places and the eigenspace of all their views.

        ``unfinished`` is a folder where what is done is kept, so that a build that was killed goes on.

        Raises
        ------
        MapError
            A reference without usable texture, filters larger than the panoramas, or more eigenimages asked for than there are.
        """
        check_filter_size(references.geometry.shape, settings)
        check_texture(references, settings)
        references = references_at(references, resolution_of(references, settings, _threads(settings)))
        everywhere = references.positions
        parts = Parts(unfinished, "" if unfinished is None else references.digest(settings.model_dump_json()))
        used, synthesizer, notes = sources_of(references, settings, progress, _threads(settings), parts)
        references = references.of(used)
        places = places_between(references, everywhere, settings, synthesizer)
        large = len(places) > MOST_DENSE
        correlator, kept = correlator_of(references, places, settings, synthesizer, progress, _threads(settings), parts, large)
        model = cls(
            places,
            settings,
            correlator,
            kept,
            synthesizer,
            notes,
            used=used,
            retrieved=len(places) if large else None,
        )
        most, threads = settings.calibration_references, _threads(settings)
        if model.retrieval is not None:
            count = learned_count(model.held_out, references, most, progress, threads, parts)
            model.retrieval = replace(model.retrieval, count=count)
        between = synthesizer is not None
        model.calibration = calibrate(model.held_out, references, most, progress, threads, settings.wrong_share, between, parts)
        if synthesizer is not None:
            synthesizer.errors = learn_source_errors(synthesizer, settings, most, progress, threads, DIM, parts)
            model.notes += synthesizer.errors.notes
        return model

    @classmethod
    def restore(cls, references: ReferencePanoramas, settings: VotesSettings, arrays: Arrays) -> Self:
        """Take up the arrays of a map file; KeyError where something is missing, as in one that an earlier version wrote."""
        everywhere = references.positions
        rows, columns = (int(size) for size in arrays["shape"])
        references = references_at(references.of(arrays["used"]), (rows, columns))
        synthesizer = None
        if "profiles" in arrays and references.camera_height_m is not None:
            profiles, alone = arrays["profiles"].astype(np.float64), arrays["alone"].astype(np.bool_)
            synthesizer = ViewSynthesizer(references, profiles, references.camera_height_m, alone)
            synthesizer.errors = SourceErrors.of_array(arrays.get("source_errors"))
        return cls(
            places_between(references, everywhere, settings, synthesizer),
            settings,
            Correlator.of_arrays(arrays, references.geometry.width, settings.bandwidth),
            float(arrays["kept"][0]),
            synthesizer,
            calibration=Calibration.of_array(arrays["calibration"], synthesizer is not None)
            if "calibration" in arrays
            else None,
            used=arrays["used"],
            retrieved=int(arrays["retrieved"][0]) if "retrieved" in arrays else None,
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a map file keeps."""
        kept: dict[str, NDArray[Any]] = {
            **self._correlator.arrays(),
            "kept": np.array([self.kept]),
            "shape": np.array(self._shape),
            "used": np.arange(len(self.places)) if self._used is None else self._used,
        }
        if self._synthesizer is not None:
            kept["profiles"] = self._synthesizer.profiles.astype(np.float32)
            kept["alone"] = self._synthesizer.alone.astype(np.uint8)
            kept["source_errors"] = self._synthesizer.errors.array()
        if self.calibration is not None:
            kept["calibration"] = self.calibration.array()
        if self.retrieval is not None:
            kept["retrieved"] = np.array([self.retrieval.count])
        return kept

    def observe(self, panorama: Panorama, headings: NDArray[np.float64] | None = None) -> VoteField:
        """Votes of one image (see `ObservationModel.observe`)."""
        return self._observe(panorama, headings, None)

    def observe_near(self, panorama: Panorama, expected: Expected) -> VoteField:
        """Votes of one image, its pose measured from where it is expected (see `TrackingModel`)."""
        return self._observe(panorama, None, expected)

    def _observe(self, panorama: Panorama, headings: Float64 | None, expected: Expected | None) -> VoteField:
        as_seen = at_resolution(panorama, self._shape)
        panorama = quiet(as_seen)
        noisy = panorama is not as_seen
        z, mask = orientations(panorama, self.settings)
        problem = useless(panorama, z, mask, self.settings)
        if problem:
            at = self._headings if headings is None else headings
            return silent_field(at, self.places, problem, headings is None)
        followed = (
            None if expected is None or self._refiner is None else self._followed(self._refiner, z, mask, expected, noisy)
        )
        proven = followed is not None and self._proves(followed)
        everywhere = expected is not None and expected.everywhere
        if followed is not None and proven and not everywhere:
            return followed
        votes, asked = self._votes(z, mask)
        field = VoteField(votes, self._headings, self.places, self._tolerance_of(votes), asked=asked, noisy=noisy)
        if headings is not None:
            best, votes = votes.max(axis=1), at_headings(votes, headings)
            return replace(field, votes=votes, headings=headings, full_circle=False, at_every_heading=best)
        if followed is not None and expected is not None and (proven or not everywhere) and expected.fits(field):
            # A closer look at the best cells would measure the same pose once more.
            return self._judged(field.with_measurement(followed.measurement))
        return self._judged(field if self._refiner is None else self._refined(self._refiner, field, z, mask))

    def rank(self, panorama: Panorama, position: Float64) -> int | None:
        """Of the place nearest to a position (2,), as retrieval ranks places for an image; None where no votes would find it."""
        assert self.retrieval is not None
        z, mask = orientations(quiet(at_resolution(panorama, self._shape)), self.settings)
        return self.retrieval.rank(z, mask, self.settings.vote_width, int(self.places.nearest(position[None])[0]))

    def _votes(self, z: Complex64, mask: NDArray[np.bool_]) -> tuple[Float32, Asked | None]:
        """Of every heading and place, or of those that are retrieved."""
        if self.retrieval is None:
            return self._correlator.votes(z, mask, self.settings.vote_width), None
        return self.retrieval.votes(z, mask, self.settings.vote_width)

    def _followed(
        self, refiner: PoseRefiner, z: Complex64, mask: NDArray[np.bool_], expected: Expected, noisy: bool
    ) -> VoteField | None:
        """The votes at a glance, with the pose measured from the expected one; None where either points elsewhere."""
        asked = None if self.retrieval is None else self.retrieval.near(expected.pose[:2])
        votes = self._correlator.glance(z, self.settings.vote_width, None if asked is None else asked.places)
        field = VoteField(
            votes, _around_the_circle(len(votes)), self.places, self._tolerance_of(votes), asked=asked, noisy=noisy
        )
        if not expected.fits(field):
            return None
        measured = refiner.follow(z, mask, expected.pose, expected.near)
        if not expected.holds(measured.pose):
            return None
        return self._judged(field.with_measurement(measured))

    def _proves(self, followed: VoteField) -> bool:
        """Whether a glance and the view at the pose agree as much as held-out references did where they were right."""
        return followed.informative and followed.confidence >= _SURE

    def _refined(self, refiner: PoseRefiner, field: VoteField, z: Complex64, mask: NDArray[np.bool_]) -> VoteField:
        """The field with the pose of the best cell, refined.

        The best few cells are looked at in turn until one agrees with the image. Synthesis sees more than the eigenspace: where it
        finds that an earlier one agrees less, the votes there shrink in proportion.
        """
        settings = self.settings.refinement
        cells = list(field.best_cells(settings.candidates))
        others = (np.array([*self.places.positions[place], self._headings[row]]) for row, place in cells[1:])
        starts = [field.best_pose, *others]
        measured, agreements = refiner.refine_best(z, mask, starts, settings.sufficient_agreement)
        best = max(agreements)
        for (row, place), agreement in zip(cells, agreements, strict=False):
            if 0.0 < agreement < best:
                field = field.weakened(row, place, agreement / best)
        return field.with_measurement(measured)

    def _judged(self, field: VoteField) -> VoteField:
        """The field with its confidence; for an image that fits nowhere, with that as its problem."""
        if self.calibration is None:
            return field
        confidence = self.calibration.confidence(field)
        # Without places in between, what it learnt from is harder than what a robot sees: nothing is refused by it.
        fits = confidence >= self.settings.fits_nowhere_below or self._synthesizer is None
        return field.judged(
            confidence, "" if fits else f"image fits nowhere in the map (confidence {100.0 * confidence:.0f} %)"
        )

    def _tolerance_of(self, votes: Float32) -> float:
        share = self.settings.tolerance
        if share is None:
            share = _USUAL_TOLERANCE if self.calibration is None else max(self.calibration.tolerance, _LEAST_TOLERANCE)
        # Votes count relative to the best one: it falls with the distance to the next place, in all lights alike.
        weakest = vote_of_cosine(np.array([self.settings.full_match], dtype=np.float32), self.settings.vote_width)[0]
        return share * max(float(votes.max()), float(weakest))

    def held_out(self, reference: int) -> VotesModel:
        """The model as though a reference had never been taken.

        The views of the places that are nearest to it are made from the others; eigenimages and depths stay as they are. Where views
        are not synthesised, its place is gone.
        """
        if self._synthesizer is None:
            norms = self._correlator.norms
            others_than = np.delete(np.arange(len(self.places)), reference)
            left = Places(self.places.positions[others_than])
            of_places = self._correlator.coefficients[others_than], norms.energy[others_than], norms.usable[others_than]
            return self._with(left, self._correlator.of_places(*of_places), None)
        references = self._synthesizer.references
        others = self._synthesizer.without(reference)
        nearest = cKDTree(references.positions).query(self.places.positions)[1]
        # Off the grid that the references may lie on, as robots are.
        moved = self.places.spacing * np.random.default_rng(reference).uniform(-0.5, 0.5, 2)
        positions = self.places.positions + np.where(nearest == reference, 1.0, 0.0)[:, None] * moved
        seen: dict[int, OfPlace] = {}
        for place in np.flatnonzero(nearest == reference):
            z, mask = synthetic_features(others, positions[place], self.settings)
            coefficients, energy = self._correlator.projections(z)[0], block_energy(z)
            energy *= np.sum(np.abs(coefficients) ** 2) / max(float(energy.sum()), 1e-12)
            seen[int(place)] = OfPlace(coefficients, energy, block_usable(mask))
        return self._with(replace(self.places, positions=positions), self._correlator.with_others(seen), others)

    def _with(self, places: Places, correlator: Correlator, synthesizer: ViewSynthesizer | None) -> VotesModel:
        """A model with the same eigenimages."""
        # It refines whatever is asked: a map is used with refinement, too, and has to know what refined poses are worth.
        refining = self.settings.refinement.model_copy(update={"enabled": True})
        settings = self.settings.model_copy(update={"refinement": refining})
        retrieved = None if self.retrieval is None else self.retrieval.count
        return VotesModel(places, settings, correlator, self.kept, synthesizer, self.notes, retrieved=retrieved)


def _around_the_circle(count: int) -> Float64:
    return np.asarray(2.0 * np.pi * np.arange(count) / count)


def _threads(settings: VotesSettings) -> int:
    return settings.virtual_places.threads or os.cpu_count() or 1
