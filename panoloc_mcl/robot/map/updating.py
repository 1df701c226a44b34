"""A map that lives on: keyframes of a later drive are added where the map has no view or no such light, and contradicted ones go.

The drive becomes a map of its own and is laid onto the old one by the images that this knows. Some of its images are held out: if the
new map reads them worse than the old one, the old one stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama, Unwrapper
from panoloc_mcl.robot.errors import ImageError, MapError
from panoloc_mcl.robot.geometry import angle_difference, compose, fitted_motion
from panoloc_mcl.robot.images import ImageSource, read_image
from panoloc_mcl.robot.map.drives import Drive, check_drives
from panoloc_mcl.robot.map.drives.common_errors import common_errors
from panoloc_mcl.robot.map.drives.mapping import map_drives
from panoloc_mcl.robot.map.drives.meetings import agreed_motion
from panoloc_mcl.robot.map.held_out import Judgement, of_keyframes, pose_of, spread_over, used_keyframes, usual_agreement
from panoloc_mcl.robot.map.joining import settled_together, stacked
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.map.pose_graph import Priors, solve
from panoloc_mcl.robot.observation import Places
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas, turned
from panoloc_mcl.robot.settings.map import MapSettings
from panoloc_mcl.robot.synthesis.spacing import LEAST_REACH_M

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

# An image tells where it was taken if it is at least this sure.
_SURE = 0.5
# Its pose is not believed to be better than this.
_LEAST_SD_M, _LEAST_SD_RAD = 0.01, np.radians(0.2)
# A keyframe farther than this from all others shows what the map has not seen, in spacings of the map; one that agrees with the map
# less than this share of the usual shows it in another light, or things have moved.
_FAR_IN_SPACINGS, _LESS_AGREEMENT = 0.8, 0.85
# Keyframes of one drive that are added are this far apart, in spacings of the map.
_APART_IN_SPACINGS = 0.6
# Every so many keyframes of the drive are held out, to judge the new map.
_HELD_OUT = 5
# Held-out images that a map must read, to be judged by them.
_FEWEST = 3
# In the same light (median grey levels within this factor) images this near a keyframe contradict it if they agree with the map there
# less than this share of the usual; so many of them do.
_SAME_LIGHT, _NEAR_IN_SPACINGS, _CONTRADICTS, _CONTRADICTIONS = 1.3, 0.7, 0.7, 2


@dataclass(frozen=True, eq=False)
class Update:
    """What an update made of a map.

    Parameters
    ----------
    panorama_map : PanoramaMap
        The new map, or the old one.
    changed : bool
        Whether it is a new one.
    notes : tuple of str
        What was done, and why.
    """

    panorama_map: PanoramaMap
    changed: bool
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Seen:
    """Keyframes of a drive as the map sees them, and their poses in the drive's own map; arrays over all of them."""

    drive: Drive
    files: tuple[ImageSource, ...]
    keyframes: Keyframes
    own: Float64
    agreement: Float64
    brightness: Float64

    @property
    def poses(self) -> Float64:
        """In the map's frame."""
        return self.keyframes.poses


def update_map(
    panorama_map: PanoramaMap,
    drives: Sequence[Drive],
    settings: MapSettings | None = None,
    progress: Progress = no_progress,
    unfinished: Path | None = None,
) -> Update:
    """Bring a map up to date with later drives.

    Parameters
    ----------
    panorama_map : PanoramaMap
    drives : sequence of Drive
    settings : MapSettings, optional
    progress : callable (done, total, what)
    unfinished : Path, optional
        A folder where what is done is kept, so that an update that was stopped goes on.

    Raises
    ------
    MapError
        Drives of a camera that does not fit the map, or on which the robot hardly moved.
    """
    settings = settings or MapSettings()
    notes: list[str] = []
    changed = False
    for drive in drives:
        notes += check_drives([drive])
        done = _updated(panorama_map, drive, settings, progress, unfinished)
        panorama_map, changed = done.panorama_map, changed or done.changed
        notes += done.notes
    return Update(panorama_map, changed, tuple(notes))


def _updated(
    panorama_map: PanoramaMap, drive: Drive, settings: MapSettings, progress: Progress, unfinished: Path | None
) -> Update:
    seen = _localized(panorama_map, drive, settings, progress, unfinished)
    if isinstance(seen, str):
        return Update(panorama_map, False, (f"drive {drive.name}: {seen}; the map stays as it is",))
    held_out = np.arange(len(seen.poses)) % _HELD_OUT == _HELD_OUT - 1
    usual = usual_agreement(panorama_map)
    added = _added(panorama_map, seen, ~held_out, usual)
    retired = _retired(panorama_map, seen, added, usual)
    if not len(added):
        return Update(
            panorama_map, False, (f"drive {drive.name}: shows nothing that the map does not know; it stays as it is",)
        )
    new = _rebuilt(panorama_map, seen, added, retired, settings.most_keyframes, progress, unfinished)
    later = [_of_drive(one, seen, np.flatnonzero(held_out)) for one in (panorama_map, new)]
    past = [of_keyframes(one, _comparable(panorama_map, new, seen)) for one in (panorama_map, new)]
    told = f"{len(added)} keyframes added, {len(retired)} retired; {_told('held-out images of the drive', *later)}" + (
        f"; {_told('keyframes of before, each without itself', *past)}" if len(past[0].metres) else ""
    )
    fewer = sum(after.right - before.right for before, after in (later, past)) < 0
    if fewer or any(after.is_worse_than(before) for before, after in (later, past)):
        return Update(panorama_map, False, (f"drive {drive.name}: the old map is kept, as the new one reads worse: {told}",))
    return Update(new, True, (f"drive {drive.name}: {told}",))


def _told(what: str, before: Judgement, after: Judgement) -> str:
    return (
        f"of {len(after.metres)} {what}, {after.right} are read rightly (before {before.right}), off by {1000 * after.median_m:.0f} mm "
        f"in the median (before {1000 * before.median_m:.0f})"
    )


def _comparable(old: PanoramaMap, new: PanoramaMap, seen: _Seen) -> list[str]:
    """Keyframes of before that the drive says nothing new of: in another light than the drive, or far from it."""
    positions, pixels = old.references.positions, old.references.pixels
    nearest = np.hypot(*(positions[:, None] - seen.poses[None, :, :2]).transpose(2, 0, 1)).argmin(axis=1)
    away = np.hypot(*(positions - seen.poses[nearest, :2]).T)
    light = seen.brightness[nearest] / np.maximum(np.median(pixels.reshape(len(pixels), -1), axis=1), 1.0)
    other = (away > LEAST_REACH_M) | (light > _SAME_LIGHT) | (light < 1.0 / _SAME_LIGHT)
    in_both = set(np.array(new.references.names)[used_keyframes(new)])
    used = used_keyframes(old)
    kept = np.array([index for index in used[other[used]] if old.references.names[index] in in_both], dtype=np.int64)
    return [old.references.names[index] for index in spread_over(kept)] if len(kept) else []


def _localized(
    panorama_map: PanoramaMap, drive: Drive, settings: MapSettings, progress: Progress, unfinished: Path | None = None
) -> _Seen | str:
    """Keyframes of a drive with their poses in the map; why not, where too few images tell them, or they contradict each other.

    The drive becomes a map of its own first, whose relative poses are those of one light; then it is laid onto the map by all images
    that this knows.
    """
    drive = replace(drive, camera=panorama_map.as_found(drive.camera, drive.image_size))
    # A camera that does not fit is told before the drive becomes a map.
    unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
    try:
        own = map_drives([drive], panorama_map.observation.votes, settings, progress, unfinished)
    except MapError as error:
        return str(error)
    if own.source.camera != drive.camera:
        drive = replace(drive, camera=own.source.camera)
        unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
    model = panorama_map.observation_model()
    keyframes, files = own.keyframes, own.source.files
    count = len(files)
    measured, sds = np.zeros((count, 3)), np.full((count, 2), np.inf)
    agreement, brightness = np.full(count, np.nan), np.full(count, np.nan)
    for index, file in enumerate(files):
        panorama = _read(unwrap, file)
        if panorama is not None:
            brightness[index] = float(np.median(panorama.pixels))
            field = model.observe(panorama)
            if field.measurement is not None and field.informative:
                agreement[index] = field.measurement.agreement.cosine
                measured[index] = field.measurement.pose
                if np.isnan(field.confidence) or field.confidence >= _SURE:
                    covariance = field.measurement.covariance
                    spread = np.sqrt([0.5 * (covariance[0, 0] + covariance[1, 1]), covariance[2, 2]])
                    sds[index] = np.maximum(spread, [_LEAST_SD_M, _LEAST_SD_RAD])
        progress(index + 1, count, f"images of {drive.name}")
    sure = np.flatnonzero(np.isfinite(sds[:, 0]))
    motion = agreed_motion(measured[sure], keyframes.poses[sure]) if len(sure) else None
    if motion is None:
        return "never meets the map"
    start = compose(motion, keyframes.poses)
    common = common_errors(keyframes.edges, start, np.zeros(count, dtype=np.int64))
    solution = solve(start, keyframes.edges, Priors(measured, sds), common=common)
    settled = replace(keyframes, poses=solution.poses, covariances=solution.covariances, edges=solution.edges)
    return _Seen(drive, files, settled, keyframes.poses, agreement, brightness)


def _read(unwrap: Unwrapper, file: object) -> Panorama | None:
    try:
        return unwrap(read_image(file))  # type: ignore[arg-type]
    except ImageError:
        return None


def _added(panorama_map: PanoramaMap, seen: _Seen, allowed: Bool, usual: float) -> Int64:
    """Keyframes where the map has no view, or fits them less than it fits others."""
    positions = panorama_map.references.positions
    spacing = Places(positions).spacing
    nearest = np.hypot(*(seen.poses[:, None, :2] - positions[None]).T).T.min(axis=1)
    wanted = allowed & np.isfinite(seen.agreement)
    wanted &= (nearest > max(_FAR_IN_SPACINGS * spacing, LEAST_REACH_M)) | (seen.agreement < _LESS_AGREEMENT * usual)
    chosen: list[int] = []
    for index in np.flatnonzero(wanted):
        apart = [np.hypot(*(seen.poses[index] - seen.poses[other])[:2]) for other in chosen]
        if min(apart, default=np.inf) >= _APART_IN_SPACINGS * spacing:
            chosen.append(int(index))
    return np.array(chosen, dtype=np.int64)


def _retired(panorama_map: PanoramaMap, seen: _Seen, added: Int64, usual: float) -> Int64:
    """Keyframes of the map that several new ones beside them, in the same light, do not fit, and that new ones replace."""
    references = panorama_map.references
    radius = _NEAR_IN_SPACINGS * Places(references.positions).spacing
    # A drive in another light fits less everywhere; what it contradicts, it fits less than the rest.
    contradicts = seen.agreement < _CONTRADICTS * min(usual, float(np.nanmedian(seen.agreement)))
    gone = []
    for index, position in enumerate(references.positions):
        near = np.hypot(*(seen.poses[:, :2] - position).T) < radius
        light = seen.brightness / max(float(np.median(references.pixels[index])), 1.0)
        alike = near & (light < _SAME_LIGHT) & (light > 1.0 / _SAME_LIGHT)
        replaced = len(added) > 0 and bool(near[added].any())
        if replaced and np.sum(alike & contradicts) >= _CONTRADICTIONS and np.mean(contradicts[alike]) > 0.5:
            gone.append(index)
    # A map that is contradicted everywhere is another place's, or its light is; nothing is retired then.
    return np.array(gone if len(gone) <= 0.5 * len(references) else [], dtype=np.int64)


def _rebuilt(
    panorama_map: PanoramaMap,
    seen: _Seen,
    added: Int64,
    retired: Int64,
    most: int,
    progress: Progress,
    unfinished: Path | None,
) -> PanoramaMap:
    """The map without those retired and with those added, bounded in size."""
    references, keyframes = panorama_map.references, panorama_map.keyframes
    kept = np.setdiff1d(np.arange(len(references)), retired)
    room = max(most - len(kept), 0)
    added = (
        added[np.unique(np.linspace(0, len(added) - 1, min(len(added), room)).round().astype(np.int64))] if room else added[:0]
    )
    images = _panoramas(panorama_map, seen)
    together = settled_together(panorama_map, seen.keyframes, images, progress)
    before = np.concatenate([keyframes.poses[:, 2], seen.poses[:, 2]])
    chosen = np.concatenate([kept, len(references) + added])
    panoramas = turned(stacked(references, images), angle_difference(together.poses[:, 2], before)).of(chosen)
    panoramas = replace(panoramas, positions=np.ascontiguousarray(together.poses[chosen, :2]))
    return panorama_map.with_keyframes(panoramas, together.of(chosen), progress, unfinished)


def _panoramas(panorama_map: PanoramaMap, seen: _Seen) -> ReferencePanoramas:
    """Images of the drive as the map's panoramas, turned to heading 0 by their poses."""
    references = panorama_map.references
    read = [
        Unwrapper(seen.drive.camera, seen.drive.image_size, references.geometry, -float(heading))(read_image(file))
        for file, heading in zip(seen.files, seen.poses[:, 2], strict=True)
    ]
    valid = None
    if any(one.valid is not None for one in read):
        valid = np.array([np.ones(one.pixels.shape, dtype=np.bool_) if one.valid is None else one.valid for one in read])
    return ReferencePanoramas(
        pixels=np.array([np.clip(np.rint(one.pixels), 0, 255) for one in read], dtype=np.uint8),
        valid=valid,
        positions=np.ascontiguousarray(seen.poses[:, :2]),
        names=seen.keyframes.names,
        geometry=references.geometry,
        camera_height_m=references.camera_height_m,
    )


def _of_drive(panorama_map: PanoramaMap, seen: _Seen, held_out: Int64) -> Judgement:
    """Of images of the drive: as its own map has them, laid onto this one."""
    model = panorama_map.observation_model()
    unwrap = panorama_map.unwrapper(seen.drive.camera, seen.drive.image_size)
    read = [_read(unwrap, seen.files[index]) for index in held_out]
    fields = [None if panorama is None else model.observe(panorama) for panorama in read]
    found = np.array([np.full(3, np.nan) if field is None else pose_of(field) for field in fields]).reshape(-1, 3)
    told = np.isfinite(found[:, 0])
    if told.sum() < _FEWEST:
        return Judgement(np.full(len(held_out), np.inf))
    expected = compose(fitted_motion(seen.own[held_out][told], found[told]), seen.own[held_out])
    return Judgement.of(found, expected)
