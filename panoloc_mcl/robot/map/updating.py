"""A map that lives on: keyframes of a later drive are added where the map has no view or no such light, and contradicted ones go.

The drive is localized in the map image by image, and its poses are settled by a pose graph of these and of odometry. Some of its images
are held out: if the new map reads them worse than the old one, the old one stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import Panorama, Unwrapper
from panoloc_mcl.robot.errors import ImageError
from panoloc_mcl.robot.geometry import angle_difference, compose
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.map.drives import Drive, check_drives, chosen_keyframes
from panoloc_mcl.robot.map.keyframes import Edges, Keyframes
from panoloc_mcl.robot.map.meetings import agreed_motion
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.map.pose_graph import Priors, solve
from panoloc_mcl.robot.observation import ObservationModel, Places, VotesModel
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.map import MapSettings

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
# Keyframes of the map whose agreement with their neighbours says what is usual.
_SAMPLED = 8
# In the same light (median grey levels within this factor) images this near a keyframe contradict it if they agree with the map there
# less than this share of the usual; so many of them do.
_SAME_LIGHT, _NEAR_IN_SPACINGS, _CONTRADICTS, _CONTRADICTIONS = 1.3, 0.7, 0.7, 2
# A held-out image is read rightly within this of where the drive has it.
_RIGHT_M = 0.25
# The new map may be worse by this much before the old one is kept.
_WORSE, _WORSE_M = 1.1, 0.002


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
    """Keyframes of a drive as the map sees them; arrays over all of them."""

    drive: Drive
    poses: Float64
    covariances: Float64
    agreement: Float64
    brightness: Float64


def update_map(
    panorama_map: PanoramaMap, drives: Sequence[Drive], settings: MapSettings | None = None, progress: Progress = no_progress
) -> Update:
    """Bring a map up to date with later drives.

    Parameters
    ----------
    panorama_map : PanoramaMap
    drives : sequence of Drive
    settings : MapSettings, optional
    progress : callable (done, total, what)

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
        done = _updated(panorama_map, drive, settings, progress)
        panorama_map, changed = done.panorama_map, changed or done.changed
        notes += done.notes
    return Update(panorama_map, changed, tuple(notes))


def _updated(panorama_map: PanoramaMap, drive: Drive, settings: MapSettings, progress: Progress) -> Update:
    model = panorama_map.observation_model()
    seen = _localized(panorama_map, model, drive.of(chosen_keyframes(drive, settings.keyframe_distance_m)), progress)
    if seen is None:
        return Update(panorama_map, False, (f"drive {drive.name}: never meets the map; the map stays as it is",))
    held_out = np.arange(len(seen.poses)) % _HELD_OUT == _HELD_OUT - 1
    usual = _usual_agreement(panorama_map)
    added = _added(panorama_map, seen, ~held_out, usual)
    retired = _retired(panorama_map, seen, added, usual)
    if not len(added):
        return Update(
            panorama_map, False, (f"drive {drive.name}: shows nothing that the map does not know; it stays as it is",)
        )
    new = _rebuilt(panorama_map, seen, added, retired, settings.most_keyframes, progress)
    before, after = (_judged(m, seen, np.flatnonzero(held_out)) for m in (panorama_map, new))
    told = (
        f"{len(added)} keyframes added, {len(retired)} retired; of {before.count} held-out images {after.right} are read rightly "
        f"(before {before.right}), median {1000 * after.median_m:.0f} mm from where the drive has them (before "
        f"{1000 * before.median_m:.0f})"
    )
    if after.right < before.right or after.median_m > _WORSE * before.median_m + _WORSE_M:
        return Update(panorama_map, False, (f"drive {drive.name}: the old map is kept, as the new one reads worse: {told}",))
    return Update(new, True, (f"drive {drive.name}: {told}",))


def _localized(panorama_map: PanoramaMap, model: ObservationModel, drive: Drive, progress: Progress) -> _Seen | None:
    """Poses of a drive's keyframes in the map; None if too few images tell them, or they contradict odometry."""
    unwrap = panorama_map.unwrapper(drive.camera, drive.image_size)
    count = len(drive.files)
    measured, sds = np.zeros((count, 3)), np.full((count, 2), np.inf)
    agreement, brightness = np.full(count, np.nan), np.full(count, np.nan)
    for index, file in enumerate(drive.files):
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
    here = drive.camera.mounting.camera_poses(drive.odometry)
    sure = np.flatnonzero(np.isfinite(sds[:, 0]))
    motion = agreed_motion(measured[sure], here[sure]) if len(sure) else None
    if motion is None:
        return None
    odometry = replace(drive, odometry=here).edges(0)
    solution = solve(compose(motion, here), odometry, Priors(measured, sds))
    # What is sure of a keyframe is no more than that of the map around it.
    return _Seen(drive, solution.poses, solution.covariances, agreement, brightness)


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
    wanted &= (nearest > _FAR_IN_SPACINGS * spacing) | (seen.agreement < _LESS_AGREEMENT * usual)
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
    contradicts = seen.agreement < _CONTRADICTS * usual
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
    panorama_map: PanoramaMap, seen: _Seen, added: Int64, retired: Int64, most: int, progress: Progress
) -> PanoramaMap:
    """The map without those retired and with those added, bounded in size."""
    references, keyframes = panorama_map.references, panorama_map.keyframes
    kept = np.setdiff1d(np.arange(len(references)), retired)
    room = max(most - len(kept), 0)
    added = (
        added[np.unique(np.linspace(0, len(added) - 1, min(len(added), room)).round().astype(np.int64))] if room else added[:0]
    )
    pixels, masks = [], []
    for index in added:
        turn = -float(seen.poses[index, 2])
        panorama = Unwrapper(seen.drive.camera, seen.drive.image_size, references.geometry, turn)(
            read_image(seen.drive.files[index])
        )
        pixels.append(np.clip(np.rint(panorama.pixels), 0, 255).astype(np.uint8))
        masks.append(np.ones(references.geometry.shape, dtype=np.bool_) if panorama.valid is None else panorama.valid)
    old = references.of(kept)
    valid = old.valid
    if valid is not None or not all(mask.all() for mask in masks):
        before = np.ones(old.pixels.shape, dtype=np.bool_) if valid is None else valid
        valid = np.concatenate([before, np.array(masks, dtype=np.bool_).reshape(-1, *references.geometry.shape)])
    names = (*old.names, *(f"{seen.drive.name}/{seen.drive.files[index].name}" for index in added))
    panoramas = ReferencePanoramas(
        pixels=np.concatenate([old.pixels, np.array(pixels, dtype=np.uint8).reshape(-1, *references.geometry.shape)]),
        valid=valid,
        positions=np.concatenate([old.positions, seen.poses[added, :2]]),
        names=names,
        geometry=references.geometry,
        camera_height_m=references.camera_height_m,
    )
    return panorama_map.with_keyframes(panoramas, _joined(keyframes.of(kept), seen, added, names), progress)


def _joined(keyframes: Keyframes, seen: _Seen, added: Int64, names: tuple[str, ...]) -> Keyframes:
    return replace(
        keyframes,
        names=names,
        given=np.concatenate([keyframes.given, seen.poses[added]]),
        poses=np.concatenate([keyframes.poses, seen.poses[added]]),
        covariances=np.concatenate([keyframes.covariances, seen.covariances[added]]),
        times=np.concatenate([keyframes.times, seen.drive.times[added]]),
        drives=(*keyframes.drives, *(seen.drive.name for _ in added)),
        edges=keyframes.edges.joined(Edges.none()),
    )


def _usual_agreement(panorama_map: PanoramaMap) -> float:
    """Agreement of the map's own keyframes with views made from their neighbours, the median of a few held out."""
    model = panorama_map.observation_model()
    if not isinstance(model, VotesModel):
        return 0.0
    count = len(panorama_map.references)
    found = []
    for index in np.unique(np.linspace(0, count - 1, min(count, _SAMPLED)).round().astype(np.int64)):
        field = model.held_out(int(index)).observe(panorama_map.references.panorama(int(index)))
        if field.measurement is not None:
            found.append(field.measurement.agreement.cosine)
    return float(np.median(found)) if found else 0.0


@dataclass(frozen=True)
class _Judgement:
    count: int
    right: int
    median_m: float


def _judged(panorama_map: PanoramaMap, seen: _Seen, held_out: Int64) -> _Judgement:
    """How a map reads images that it was not made of."""
    model = panorama_map.observation_model()
    unwrap = panorama_map.unwrapper(seen.drive.camera, seen.drive.image_size)
    errors = []
    for index in held_out:
        panorama = _read(unwrap, seen.drive.files[index])
        field = None if panorama is None else model.observe(panorama)
        if field is None or not field.informative:
            errors.append(np.inf)
            continue
        pose = field.best_pose if field.measurement is None else field.measurement.pose
        turned = abs(float(angle_difference(pose[2], seen.poses[index, 2])))
        errors.append(float(np.hypot(*(pose - seen.poses[index])[:2])) if turned < np.radians(10.0) else np.inf)
    found = np.array(errors)
    right = found < _RIGHT_M
    return _Judgement(len(found), int(right.sum()), float(np.median(found[right])) if right.any() else _RIGHT_M)
