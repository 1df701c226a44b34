"""A localizer's state in a file: all that the next estimate depends on, with which map and settings, and how it is taken up again."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import StateError
from panoloc_mcl.robot.files import read_arrays, write_arrays
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.interface.contradictions import Contradictions
from panoloc_mcl.robot.interface.frozen_camera import FrozenCamera
from panoloc_mcl.robot.interface.mounting_tilt import MountingTilt
from panoloc_mcl.robot.interface.steering import Steering
from panoloc_mcl.robot.locks import locked
from panoloc_mcl.robot.motion import Anchor, ImageClock, OdometryBuffer
from panoloc_mcl.robot.settings.config import LocalizerConfig

FORMAT = "panoloc-state/8"
# Of a state of an earlier form only the pose is taken over, if its particles lie within this: farther apart, they are no pose.
_ONE_POSE_M = 1.0

Arrays = Mapping[str, NDArray[Any]]

# Of the localizer, besides its parts.
_REMEMBERED = ("_pace", "_reported", "_forced", "_has_fix", "_images", "_gated", "_begun_anew", "images_skipped")


class SavedState(Steering):
    """Saved and resumed."""

    @locked
    def save_state(self, path: str | Path) -> None:
        """Save all that the next estimate depends on, whole or not at all: a localizer that loads it goes on to the last bit.

        Parameters
        ----------
        path : str or Path
            An npz file.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        filter_arrays, filter_header = self._filter.snapshot()
        odometry_arrays, odometry_header = self._odometry.snapshot()
        header = {
            "filter": filter_header,
            "odometry": odometry_header,
            "clock": self._clock.snapshot(),
            "sightings": self._sightings.snapshot(),
            "frozen_camera": self._frozen_camera.snapshot(),
            **{name: getattr(self, name) for name in _REMEMBERED},
        }
        camera = {"tilt": self._mounting_tilt.array(), "contradictions": self._contradictions.array()}
        parts = {"filter": filter_arrays, "odometry": odometry_arrays, "mount": camera}
        if self._anchor is not None:
            anchor, status = self._anchor
            parts["anchor"] = {"pose": anchor.pose, "covariance": anchor.covariance}
            header["anchor"] = {"timestamp": anchor.timestamp, "status": status.value}
        _write(Path(path), self.map_revision, self.config, header, parts)

    @locked
    def load_state(self, path: str | Path) -> None:
        """Go on from a saved state; this localizer's start pose and seed no longer matter.

        Parameters
        ----------
        path : str or Path
            From `save_state`, with the same map and the same settings of observation and localizer.

        Raises
        ------
        StateError
            Missing or damaged, or saved with another map, other settings or another version. This localizer is then as before.
        """
        header, parts = _read(Path(path), self.map_revision, self._map.name, self.config)
        try:
            self._take_over(header, parts)
        except (LookupError, ValueError, TypeError, AttributeError) as error:
            raise StateError(f"{path}: the saved state is damaged ({error}); start anew and save it again") from error

    @locked
    def resume(self, path: str | Path) -> None:
        """Go on from the state that a stopped program saved: as `load_state`, but time has gone on without this localizer.

        The next image counts whatever its stamp. If odometry goes on where it was, the way between is known; if not, the belief is
        widened by what the robot can have driven. Of a state that an earlier version saved, the pose is taken over, with a warning.

        Raises
        ------
        StateError
            As `load_state`.
        """
        earlier = _pose_of_earlier(Path(path))
        if earlier is None:
            self.load_state(path)
            self._clock.pause()
        else:
            pose, covariance = earlier
            # Particles are poses of the camera.
            self.set_pose(self._mount.base_poses(pose), covariance)
            warnings.warn(f"{path}: saved by an earlier version; only its last pose is taken over", stacklevel=2)

    def _take_over(self, header: Mapping[str, Any], parts: Mapping[str, dict[str, NDArray[Any]]]) -> None:
        odometry = OdometryBuffer(self.settings.motion)
        odometry.restore(parts["odometry"], header["odometry"])
        clock = ImageClock(self.settings.motion, odometry)
        clock.restore(header["clock"])
        sightings = self._new_sightings(None)
        sightings.restore(header["sightings"])
        values = {name: header[name] for name in _REMEMBERED}
        anchor = None
        if "anchor" in header:
            pose, covariance = (np.array(parts["anchor"][name], dtype=np.float64) for name in ("pose", "covariance"))
            if pose.shape != (3,) or covariance.shape != (3, 3):
                raise ValueError(f"last pose of shape {pose.shape}, covariance of shape {covariance.shape}")
            anchor = Anchor(float(header["anchor"]["timestamp"]), pose, covariance), Status(header["anchor"]["status"])
        mounting_tilt = MountingTilt.of_array(np.asarray(parts["mount"]["tilt"], dtype=np.float64))
        # States that are a little older do not have these.
        frozen_camera = FrozenCamera.of_snapshot(header.get("frozen_camera"))
        contradictions = Contradictions.of_array(parts["mount"].get("contradictions", Contradictions().array()))
        # The last that can fail; it changes nothing if it does.
        self._filter.restore(parts["filter"], header["filter"])
        vars(self).update(values)
        self._odometry, self._clock, self._sightings, self._anchor = odometry, clock, sightings, anchor
        self._mounting_tilt, self._contradictions, self._frozen_camera = mounting_tilt, contradictions, frozen_camera


def _write(
    path: Path, fingerprint: str, config: LocalizerConfig, header: Mapping[str, Any], parts: Mapping[str, Arrays]
) -> None:
    """Write a state, whole or not at all.

    Parameters
    ----------
    path : Path
    fingerprint : str
        Of the map.
    config : LocalizerConfig
    header : mapping
        Plain values.
    parts : mapping of str to arrays
        By the part of the localizer that they belong to.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    arrays = {f"{part}.{name}": array for part, some in parts.items() for name, array in some.items()}
    own = {"format": FORMAT, "map": fingerprint, "settings": _that_count(config)}
    write_arrays(path, own | dict(header), arrays)


def _read(path: Path, fingerprint: str, map_name: str, config: LocalizerConfig) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read what `_write` wrote: the header, and the arrays of each part.

    Raises
    ------
    StateError
        Missing or damaged, or saved with another map, other settings or another version.
    """
    try:
        header, arrays = read_arrays(path)
    except FileNotFoundError:
        raise StateError(f"{path}: no such file; check the path") from None
    except (OSError, ValueError) as error:
        raise StateError(f"{path}: not a saved state ({error}); start anew and save it again") from error
    if header.get("format") != FORMAT:
        raise StateError(f"{path}: format is {header.get('format')!r}, this version reads '{FORMAT}'; start anew")
    if header.get("map") != fingerprint:
        raise StateError(f"{path}: saved with another map than '{map_name}'; load the map that it was saved with")
    different = _first_difference(header.get("settings"), _that_count(config))
    if different:
        raise StateError(f"{path}: saved with {different}; use the settings that it was saved with, or start anew")
    parts: dict[str, Any] = {}
    for key, array in arrays.items():
        part, _, name = key.partition(".")
        parts.setdefault(part, {})[name] = array
    return header, parts


def _pose_of_earlier(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Camera pose and covariance of a state of an earlier form; None where it is of this one, holds no pose, or cannot be read."""
    try:
        header, arrays = read_arrays(path)
        poses, log_weights = arrays["filter.poses"], arrays["filter.log_weights"]
    except (OSError, ValueError, KeyError):
        return None
    name, _, number = str(header.get("format")).partition("/")
    this, _, newest = FORMAT.partition("/")
    if name != this or not number.isdecimal() or int(number) >= int(newest):
        return None
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    turns = poses[:, 2]
    heading = np.arctan2(weights @ np.sin(turns), weights @ np.cos(turns))
    mean = np.array([*(weights @ poses[:, :2]), heading])
    off = np.column_stack([poses[:, :2] - mean[:2], angle_difference(turns, heading)])
    covariance = (weights * off.T) @ off
    if not np.sqrt(np.trace(covariance[:2, :2])) < _ONE_POSE_M:
        return None
    # How far the robot was driven since is not known: half a metre and 45 degrees.
    return mean, np.asarray(covariance + np.diag([0.5, 0.5, np.radians(45.0)]) ** 2)


def _that_count(config: LocalizerConfig) -> dict[str, Any]:
    """The settings that a saved state depends on: not where it began, nor how many threads work."""
    settings = config.model_dump(mode="json")
    settings["localizer"].pop("initial")
    settings["localizer"].pop("initial_heading_error_deg")
    settings["localizer"]["monte_carlo"].pop("threads")
    return {name: settings[name] for name in ("observation", "localizer")}


def _first_difference(saved: Any, now: Any, key: str = "") -> str:
    """The first setting that differs, as ``key = saved, now this``; empty when none does."""
    if isinstance(saved, dict) and isinstance(now, dict):
        parts = (
            _first_difference(saved.get(name), now.get(name), f"{key}.{name}" if key else name) for name in {**saved, **now}
        )
        return next((part for part in parts if part), "")
    return "" if saved == now else f"{key or 'settings'} = {json.dumps(saved)}, now {json.dumps(now)}"
