"""The map: reference panoramas, and everything that an observation model precomputed from them, in one file."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from threadpoolctl import threadpool_limits

from panoloc_mcl.robot.camera import Camera, PanoramaGeometry, Unwrapper
from panoloc_mcl.robot.errors import MapError, PanolocError
from panoloc_mcl.robot.map import map_file
from panoloc_mcl.robot.map.drives import Drive
from panoloc_mcl.robot.map.drives.mapping import map_drives
from panoloc_mcl.robot.map.headings import with_headings
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.map.map_contents import contents, fields
from panoloc_mcl.robot.map.mended import Mended
from panoloc_mcl.robot.map.mending import mend
from panoloc_mcl.robot.map.own_body import with_found_mask
from panoloc_mcl.robot.map.own_tilt import with_found_tilt
from panoloc_mcl.robot.observation import ObservationModel, Places, differences, model_named
from panoloc_mcl.robot.observation.base import Arrays
from panoloc_mcl.robot.observation.scale import references_at, resolution_of
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import Recorded, ReferencePanoramas, References
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.settings.observation import ObservationSettings
from panoloc_mcl.robot.synthesis.explained_rows import explained

_LEAST_SEEN = 0.5
_HEIGHT_TOLERANCE = 0.25


@dataclass(frozen=True, eq=False)
class PanoramaMap:
    """A map of one place.

    Parameters
    ----------
    name : str
        Of the data set it was built from.
    references : ReferencePanoramas
    camera : PanoramaCamera or OmniCamera
        That took the references.
    image_size : (int, int)
        Width and height of its images, pixels.
    observation : ObservationSettings
        The model and the settings that were precomputed.
    seed : int
        For models that draw random pixels.
    arrays : mapping of str to ndarray
        What that model precomputed.
    keyframes : Keyframes
        Poses of the references with covariances, and which see which.
    notes : tuple of str
        What the user should know of how the map turned out.
    found_body : bool
        Whether the camera's mask was found in the references, where nobody gave one.
    found_tilt : bool
        Whether pitch and roll of its mount were.
    """

    name: str
    references: ReferencePanoramas
    camera: Camera
    image_size: tuple[int, int]
    observation: ObservationSettings
    seed: int
    arrays: Arrays
    keyframes: Keyframes
    notes: tuple[str, ...] = ()
    found_body: bool = False
    found_tilt: bool = False

    def __post_init__(self) -> None:
        # Views made from references err by what these are off.
        object.__setattr__(self, "references", replace(self.references, sds=self.keyframes.sds))

    @classmethod
    def build(
        cls,
        dataset: Recorded,
        observation: ObservationSettings | None = None,
        seed: int = 0,
        progress: Progress = no_progress,
        settings: MapSettings | None = None,
        unfinished: Path | None = None,
    ) -> Self:
        """Build a map from the references of a data set.

        Parameters
        ----------
        dataset : Dataset
            Or whatever else has a ``name`` and ``references``.
        observation : ObservationSettings, optional
            Which model to precompute, and how; the default model if left out.
        seed : int
        progress : callable (done, total, what)
        settings : MapSettings, optional
            How given poses are mended.
        unfinished : Path, optional
            A folder where what is done is kept, so that a build that was stopped goes on there.

        Raises
        ------
        MapError, DatasetError, ImageError
            References that cannot be read or used; settings that ask for more than they give.
        """
        observation = observation or ObservationSettings()
        # One BLAS thread, so that the order of sums, and with it the map to the last bit, does not depend on the machine's cores.
        with threadpool_limits(1, user_api="blas"):
            threads = os.cpu_count() or 1

            def as_compared(references: ReferencePanoramas) -> ReferencePanoramas:
                return references_at(references, resolution_of(references, observation.votes, threads))

            settings = settings or MapSettings()
            source, body = _without_body(dataset.references) if settings.find_body else (dataset.references, ())
            source, turned = with_headings(source, observation.votes, settings, progress, threads)
            source, left_out = explained(source, observation.votes, as_compared, threads)
            mended = mend(source, observation.votes, settings, progress, unfinished)
            camera, tilt = _tilt(mended, observation, settings, progress)
            if tilt:
                mended = mend(replace(source, camera=camera), observation.votes, settings, progress, unfinished)
        mended = replace(mended, notes=(*body, *turned, *left_out, *tilt, *mended.notes))
        built = cls.of_keyframes(dataset.name, mended, observation, seed, progress, unfinished)
        return replace(built, found_body=bool(body), found_tilt=bool(tilt))

    @classmethod
    def of_drives(
        cls,
        name: str,
        drives: Sequence[Drive],
        observation: ObservationSettings | None = None,
        seed: int = 0,
        progress: Progress = no_progress,
        settings: MapSettings | None = None,
        unfinished: Path | None = None,
    ) -> Self:
        """Build a map from drives with odometry; its frame is that of the first drive's odometry at its first keyframe.

        Parameters
        ----------
        name : str
        drives : sequence of Drive
        observation, seed, progress, settings
            As in `build`.
        unfinished : Path, optional
            As in `build`.

        Raises
        ------
        MapError, ImageError
            Drives that no map can be made of; images that cannot be read.
        """
        observation = observation or ObservationSettings()
        with threadpool_limits(1, user_api="blas"):
            settings = settings or MapSettings()
            mended = map_drives(drives, observation.votes, settings, progress, unfinished)
            camera, tilt = _tilt(mended, observation, settings, progress)
            if tilt:
                mount = {"mount": camera.mounting}
                leaning = [replace(drive, camera=drive.camera.model_copy(update=mount)) for drive in drives]
                mended = map_drives(leaning, observation.votes, settings, progress, unfinished)
                mended = replace(mended, notes=(*tilt, *mended.notes))
        built = cls.of_keyframes(name, mended, observation, seed, progress, unfinished)
        found_body = built.camera.mask is not None and drives[0].camera.mask is None
        return replace(built, found_body=found_body, found_tilt=bool(tilt))

    @classmethod
    def of_keyframes(
        cls,
        name: str,
        mended: Mended,
        observation: ObservationSettings,
        seed: int = 0,
        progress: Progress = no_progress,
        unfinished: Path | None = None,
    ) -> Self:
        """A map of keyframes whose poses are settled."""
        source, references = mended.source, replace(mended.panoramas, sds=mended.keyframes.sds)
        model = _built(references, observation, seed, progress, unfinished)
        notes = (*mended.notes, *model.notes)
        made = (observation, seed, model.arrays(), mended.keyframes, notes)
        return cls(name, references, source.camera, source.image_size, *made)

    def with_keyframes(
        self,
        references: ReferencePanoramas,
        keyframes: Keyframes,
        progress: Progress = no_progress,
        unfinished: Path | None = None,
    ) -> PanoramaMap:
        """The map made anew of other keyframes, with the same camera and settings (``unfinished`` as in `build`)."""
        references = replace(references, sds=keyframes.sds)
        model = _built(references, self.observation, self.seed, progress, unfinished)
        return replace(self, references=references, keyframes=keyframes, arrays=model.arrays(), notes=model.notes)

    @property
    def places(self) -> Places:
        """Where the references were taken."""
        return Places(self.references.positions)

    @property
    def geometry(self) -> PanoramaGeometry:
        """Of the canonical panoramas that the map compares."""
        return self.references.geometry

    def observation_model(self, observation: ObservationSettings | None = None) -> ObservationModel:
        """The observation model: restored if it was built with these settings (its own if left out), otherwise computed anew.

        Then a warning names what differs, as this takes as long as building the map.
        """
        observation = observation or self.observation
        settings = observation.selected
        model = model_named(observation.model)
        differing = differences(observation, self.observation)
        if differing:
            warnings.warn(
                f"map '{self.name}': was built with other settings than {', '.join(differing)}; it is computed anew from its "
                f"{len(self.references)} references, which takes as long as building it: leave these as the map has them, or build "
                "a map with them (panoloc build-map --set)",
                stacklevel=2,
            )
        else:
            try:
                return model.restore(self.references, settings, self.arrays)
            except KeyError as missing:
                warnings.warn(
                    f"map '{self.name}': made by an earlier version, without {missing}; computed again from its references (panoloc "
                    "build-map makes a file that need not)",
                    stacklevel=2,
                )
        with threadpool_limits(1, user_api="blas"):
            return model.build(self.references, settings, self.seed)

    def unwrapper(self, camera: Camera | None = None, image_size: tuple[int, int] | None = None) -> Unwrapper:
        """From a camera's images to the panoramas that this map compares.

        Raises
        ------
        MapError
            The camera sees too little of what the map shows, or from another height.
        """
        if camera is None:
            return Unwrapper(self.camera, image_size or self.image_size, self.geometry)
        camera = self.as_found(camera, image_size)
        mine, theirs = self.references.camera_height_m, camera.height_m
        if mine is not None and theirs is not None and abs(theirs - mine) > _HEIGHT_TOLERANCE * mine:
            raise MapError(
                f"map '{self.name}': built with the camera {mine} m above the floor, this camera is at height_m = {theirs}; "
                "build a map with this camera's height"
            )
        unwrapper = Unwrapper(camera, image_size or self.image_size, self.geometry)
        seen = 1.0 if unwrapper.valid is None else float(unwrapper.valid.mean())
        if seen < _LEAST_SEEN:
            raise MapError(
                f"map '{self.name}': built for another camera: this one sees {100 * seen:.0f} % of the map's "
                f"panoramas (elevation {self.geometry.elevation_bottom_deg} to {self.geometry.elevation_top_deg} degrees); build "
                "a map with a camera that sees the same elevations"
            )
        return unwrapper

    def as_found(self, camera: Camera, image_size: tuple[int, int] | None = None) -> Camera:
        """A camera with the mask and the tilt that were found in the references, if it is the same camera and has none of its own.

        Parameters
        ----------
        camera : AnyCamera
        image_size : (int, int), optional
            Width and height of its images; as the references if left out.
        """
        if (image_size or self.image_size) != self.image_size:
            return camera
        found, mount = camera, self.camera.mounting
        if self.found_body and camera.mask is None:
            found = found.model_copy(update={"mask": self.camera.mask})
        if self.found_tilt and camera.mounting.is_upright:
            turned = camera.mounting.model_copy(update={"pitch_deg": mount.pitch_deg, "roll_deg": mount.roll_deg})
            found = found.model_copy(update={"mount": turned})
        # Stamps do not change what it sees.
        same = self.camera.model_copy(update={"time_offset_s": camera.time_offset_s, "mount": mount})
        return found if found.model_copy(update={"mount": found.mounting}) == same else camera

    def save(self, path: str | Path) -> None:
        """Write the map, whole or not at all.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        map_file.write(Path(path), *contents(self))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a map.

        Raises
        ------
        MapError
            Missing, truncated, not a map, or of a newer format.
        """
        header, tensors = map_file.read(Path(path))
        try:
            return cls(**fields(header, tensors, str(path)))
        except (LookupError, ValueError, TypeError, AttributeError, PanolocError) as error:
            raise MapError(f"{path}: the map's header is damaged ({error}); build it again with panoloc build-map") from error


def _without_body(references: References) -> tuple[References, tuple[str, ...]]:
    """References whose camera has a mask, and a note of it, where the robot was found in their images."""
    camera, note = with_found_mask(references.camera, references.image_size, references.files, references.poses)
    return replace(references, camera=camera) if note else references, note


def _tilt(
    mended: Mended, observation: ObservationSettings, settings: MapSettings, progress: Progress
) -> tuple[Camera, tuple[str, ...]]:
    """The camera as it leans, and a note of it where that was not known."""
    # Without relative poses, floor and walls do not describe the world, and images tell no lean.
    if settings.find_tilt and len(mended.keyframes.edges):
        return with_found_tilt(mended.source, observation.votes, progress)
    return mended.source.camera, ()


def _built(
    references: ReferencePanoramas, observation: ObservationSettings, seed: int, progress: Progress, unfinished: Path | None
) -> ObservationModel:
    # Other models are made in no time.
    kept = {"unfinished": unfinished} if observation.model == "votes" else {}
    with threadpool_limits(1, user_api="blas"):
        return model_named(observation.model).build(references, observation.selected, seed, progress, **kept)
