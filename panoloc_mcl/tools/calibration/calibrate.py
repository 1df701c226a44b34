"""The whole of it: what a data set tells about its camera, as a camera, a table and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.camera import AnyCamera, Mask
from panoloc_mcl.robot.camera.body import FEWEST_IMAGES, MOST_IMAGES, FoundBody, find_body, grey_levels, ring_of
from panoloc_mcl.robot.errors import DatasetError, ImageError
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.map.camera_search.adjustment import Adjustment, Estimated, Scene, search
from panoloc_mcl.robot.map.camera_search.features import FINE_COLUMNS
from panoloc_mcl.robot.map.camera_search.parameters import Parameter, changed
from panoloc_mcl.robot.map.camera_search.references_scene import ReferencesScene
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.calibration.drives_scene import DrivesScene, Track, Yardstick
from panoloc_mcl.tools.calibration.odometry import (
    LATE,
    OBSERVABLE_M,
    OBSERVABLE_RAD,
    OBSERVABLE_S,
    Placement,
    place_camera,
    pooled,
)
from panoloc_mcl.tools.calibration.parameters import parameters_by_map, parameters_by_references, shown
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.datasets import Sequence as Drive

Float32 = NDArray[np.float32]

# A found value is taken over where it differs from the given one by so many standard deviations, and gains something.
_SIGNIFICANT = 2.0
_LEAST_HIDDEN = 1e-3
# Drives looked at, and images of them in all, for the optics of their camera; drives for where it sits.
_MOST_DRIVES, _MOST_OF_DRIVES, _MOST_PLACED = 6, 36, 3


@dataclass(eq=False)
class Findings:
    """What calibrating found.

    Parameters
    ----------
    before, camera : AnyCamera
        As described, and as found.
    of_drives : bool
        Whether it is the camera of the drives, which the references are the yardstick for, or that of all images.
    lines : list of str
        Verdicts, one line each.
    estimates : list of Estimated
    body : FoundBody or None
    adjustment : Adjustment or None
    sample : uint8 or uint16 image
        One of the camera's images, for the picture.
    scene : ReferencesScene or None
        For the picture of views.
    doubted : bool
        Whether images agreed no better with what the search found, so that it says nothing.
    """

    before: AnyCamera
    camera: AnyCamera
    of_drives: bool
    sample: NDArray[Any]
    lines: list[str] = field(default_factory=list)
    estimates: list[Estimated] = field(default_factory=list)
    body: FoundBody | None = None
    adjustment: Adjustment | None = None
    scene: ReferencesScene | None = None
    doubted: bool = False


def calibrate(
    dataset: Dataset,
    camera: AnyCamera | None = None,
    drives: Sequence[Drive] | None = None,
    progress: Progress = no_progress,
    panorama_map: PanoramaMap | None = None,
    only_mask: bool = False,
) -> Findings:
    """Find the mask, the errors of the calibration, and where the camera sits.

    Parameters
    ----------
    dataset : Dataset
    camera : AnyCamera, optional
        Where to begin; as the data set says if left out.
    drives : sequence of Sequence, optional
        That may be looked at; all if left out.
    progress : callable (done, total, what)
    panorama_map : PanoramaMap, optional
        Of the references, if there is one, for drives with a camera of their own.
    only_mask : bool
        Leave the rest of the description as it is.

    Raises
    ------
    DatasetError
        Too few images, places without height, and the like.
    """
    references = dataset.references
    drives = list(dataset.sequences.values()) if drives is None else list(drives)
    own = [drive for drive in drives if _without_stamps(drive.camera) != _without_stamps(references.camera)]
    of_drives = bool(own)
    described = (own[0].camera if of_drives else references.camera) if camera is None else camera
    subjects = [drive for drive in drives if (drive in own) == of_drives and (not of_drives or drive.camera == own[0].camera)]
    files = [file for drive in subjects for file in drive.files] + ([] if of_drives else list(references.files))
    size = subjects[0].image_size if of_drives else references.image_size
    images = _images(files)
    if not images:
        raise DatasetError(f"{dataset.path}: none of its images can be read; the camera cannot be told without any")
    found = Findings(described, described, of_drives, images[len(images) // 2])
    found.lines.append(f"camera of {'the drives, held against the references' if of_drives else 'all images'}")
    _find_mask(found, images, size)
    if only_mask:
        return found
    settings = VotesSettings()
    if not of_drives:
        start = references.__class__(
            references.path, references.files, references.poses, found.camera, size, references.poses_of, references.sds
        )
        coarse = ReferencesScene(start, settings, found.camera)
        of_base = references.poses_of == "base"
        parameters = parameters_by_references(found.camera, placed=of_base, place_sd_m=coarse.place_sd_m())

        def last(rough: AnyCamera) -> ReferencesScene:
            found.scene = ReferencesScene(start, settings, rough, columns=FINE_COLUMNS)
            return found.scene

        _search(found, parameters, coarse, last, progress)
        yard = references.__class__(
            references.path, references.files, references.poses, found.camera, size, references.poses_of
        )
    else:
        yard = references
    with_odometry = [drive for drive in subjects if drive.odometry is not None and len(drive) >= FEWEST_IMAGES]
    if of_drives or with_odometry:
        yardstick = Yardstick(yard, settings, progress, panorama_map if of_drives else None)
        if of_drives:
            looked_at = subjects[:_MOST_DRIVES]
            most = -(-_MOST_OF_DRIVES // len(looked_at))

            def tracked(camera: AnyCamera) -> list[Track]:
                tracks = [yardstick.track(drive, camera, most, progress) for drive in looked_at]
                return [track for track in tracks if len(track.indices)]

            tracks = tracked(found.camera)
            if sum(len(track.indices) for track in tracks) >= FEWEST_IMAGES:
                _search(
                    found,
                    parameters_by_map(found.camera),
                    DrivesScene(yardstick, tracks),
                    lambda rough: DrivesScene(yardstick, tracked(rough), _MOST_OF_DRIVES, FINE_COLUMNS),
                    progress,
                )
        _place(found, [yardstick.track(drive, found.camera, progress=progress) for drive in with_odometry[:_MOST_PLACED]])
    if not with_odometry:
        found.lines.append("mount.x_m, mount.y_m, time_offset_s: not observable without a drive with odometry")
    return found


def _without_stamps(camera: AnyCamera) -> AnyCamera:
    return camera.model_copy(update={"time_offset_s": None})


def _images(files: Sequence[Any]) -> list[NDArray[Any]]:
    """Some of the images, evenly over all; damaged ones are left out."""
    chosen = np.unique(np.linspace(0, len(files) - 1, MOST_IMAGES).round().astype(int)).tolist() if files else []
    found = []
    for index in chosen:
        try:
            found.append(read_image(files[index]))
        except ImageError:
            continue
    return found


def _find_mask(found: Findings, images: list[NDArray[Any]], size: tuple[int, int]) -> None:
    if found.before.mask is not None:
        found.lines.append("mask: given, kept as it is")
        return
    if len(images) < FEWEST_IMAGES:
        found.lines.append(f"mask: not observable, {len(images)} images are fewer than {FEWEST_IMAGES}")
        return
    found.body = find_body([grey_levels(image) for image in images], ring_of(found.before, size))
    found.lines.append(found.body.verdict)
    if found.body.sure and found.body.hidden > _LEAST_HIDDEN:
        found.camera = found.camera.model_copy(update={"mask": Mask(found.body.world)})


def _search(
    found: Findings,
    parameters: list[Parameter],
    coarse: Scene,
    last: Callable[[AnyCamera], Scene],
    progress: Progress,
) -> None:
    """From far with large pixels, then the rest with finer ones."""
    rough = search(found.camera, parameters, coarse, progress)
    fine = last(rough.camera)
    _take_over(found, search(found.camera, parameters, fine, progress, rough), fine)


def _take_over(found: Findings, adjustment: Adjustment, scene: Scene) -> None:
    """The values that differ from what is described by more than chance; the others stay as they are."""
    found.adjustment = adjustment
    differ = {one.parameter.name: one for one in adjustment.told(_SIGNIFICANT)}
    values = {name: round(one.value, 5) for name, one in differ.items()}
    camera = changed(found.camera, [one.parameter for one in differ.values()], values)
    if differ and isinstance(scene, ReferencesScene):
        gain, error = scene.gain(camera, found.camera)
        if gain < _SIGNIFICANT * error:
            # A search has errors of its own; what shows in no image is not better.
            found.lines.append(f"kept as described, for images agree no better with what was found: {', '.join(differ)}")
            differ, camera, found.doubted = {}, found.camera, True
    found.camera = camera
    found.estimates += [differ.get(one.parameter.name, one) for one in adjustment.estimates]
    told = [one for one in adjustment.estimates if one.observable]
    found.lines.append(f"agreement of {adjustment.images} images with views of them: {adjustment.after:.3f}")
    if differ and len(differ) < len(told):
        kept = ", ".join(one.parameter.name for one in told if one.parameter.name not in differ)
        found.lines.append(f"kept as described, within {_SIGNIFICANT:g} standard deviations: {kept}")
    unseen = [one.parameter.name for one in adjustment.estimates if not one.observable]
    if unseen:
        found.lines.append(f"not observable: {', '.join(unseen)}")


def _place(found: Findings, tracked: Sequence[Any]) -> None:
    """Where the camera sits on the base, by the odometry of drives."""
    placements: list[Placement] = []
    for track in tracked:
        odometry = track.drive.odometry
        if odometry is not None:
            placement = place_camera(track.times, track.poses, odometry.times, odometry.poses)
            placements += [placement] if placement is not None else []
    if not placements:
        return
    mount = found.camera.mounting
    known = {one.parameter.name: one for one in found.estimates if one.observable and not found.doubted}
    x, y, yaw, late = (
        pooled([getattr(one, name) for one in placements], [getattr(one, sd) for one in placements])
        for name, sd in (("x_m", "sd_x_m"), ("y_m", "sd_y_m"), ("yaw", "sd_yaw"), ("time_offset_s", "sd_time_s"))
    )
    update: dict[str, float] = {}
    for name, key, given, (value, sd) in (("forward", "x_m", mount.x_m, x), ("left", "y_m", mount.y_m, y)):
        _weigh(found, update, (f"mount.{key}", "m", key), (given, value, sd, OBSERVABLE_M), known.get(name))
    if found.of_drives:
        turned = mount.yaw_deg - float(np.degrees(yaw[0]))
        limit, sd_deg = float(np.degrees(OBSERVABLE_RAD)), float(np.degrees(yaw[1]))
        _weigh(found, update, ("mount.yaw_deg", "deg", "yaw_deg"), (mount.yaw_deg, turned, sd_deg, limit), None)
    if update:
        found.camera = found.camera.model_copy(update={"mount": mount.model_copy(update=update)})
    given, seen = found.camera.stamp_offset_s, late[1] <= OBSERVABLE_S
    value = given + late[0] if seen else given
    found.estimates.append(_estimate("time_offset_s", "s", given, value, late[1] if seen else np.inf))
    if seen and abs(late[0]) > LATE * late[1]:
        found.camera = found.camera.model_copy(update={"time_offset_s": round(value, 4)})
    if max(x[1], y[1]) > OBSERVABLE_M:
        found.lines.append("mount.x_m, mount.y_m: not observable, no drive turns enough")
    scale, images = np.mean([one.odometry_scale for one in placements]), sum(one.images for one in placements)
    found.lines.append(f"odometry: {scale:.3f} m of the map a metre, over {images} images")


def _weigh(
    found: Findings,
    update: dict[str, float],
    names: tuple[str, str, str],
    figures: tuple[float, float, float, float],
    known: Estimated | None,
) -> None:
    """Enter what a drive tells, together with what the references told before it, each by its standard deviation."""
    (name, unit, key), (given, value, sd, limit) = names, figures
    if sd > limit:
        found.estimates.append(_estimate(name, unit, given, given, np.inf))
        return
    if known is not None:
        value, sd = pooled([known.value, value], [known.sd, sd])
    found.estimates.append(_estimate(name, unit, given, value, sd))
    if abs(value - given) > _SIGNIFICANT * sd:
        update[key] = round(value, 4)


def _estimate(name: str, unit: str, given: float, value: float, sd: float) -> Estimated:
    return Estimated(Parameter(name, unit, given, 0.0, 0.0, 0.0, lambda camera, _: camera), value, sd)


def table_of(found: Findings) -> list[tuple[str, str, str, str]]:
    """Rows of name, value as described, value as found (whether it is taken over, the verdicts say), standard deviation."""
    rows = []
    for one in found.estimates:
        unit = one.parameter.unit
        after = shown(one.value, unit) if one.observable else "not observable"
        sd = shown(one.sd, unit) if one.observable else ""
        name = f"{one.parameter.name} [{unit}]" if unit else one.parameter.name
        rows.append((name, shown(one.parameter.start, unit), after, sd))
    return rows
