"""The state of a localizer on several maps in files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from panoloc_mcl.robot.errors import StateError
from panoloc_mcl.robot.files import read_arrays, write_arrays
from panoloc_mcl.robot.floors.belief import FloorBelief
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.locks import Lock, locked

_FORMAT = "panoloc-floors/2"
# One set of files beside it, written in place.
_FORMAT_BEFORE = "panoloc-floors/1"


class SavedFloors(ABC):
    """Saved and resumed: what `FloorLocalizer` has, and others need not know."""

    _lock: Lock
    _names: tuple[str, ...]
    _localizers: dict[str, Localizer]
    _belief: FloorBelief

    @abstractmethod
    def relocalize(self) -> None:
        """Forget map and pose."""

    @locked
    def save_state(self, path: str | Path) -> None:
        """Save the belief over the maps in this file, and the state of each map's localizer in one beside it; all or nothing.

        The localizers' files are new ones each time, and this file, written last, says which: until then those before hold. When an
        image counted last and how far the robot has come since are not kept: the next image is taken for new.

        Raises
        ------
        OutputError
            A file cannot be written.
        """
        path = Path(path)
        before = _saved_before(path)
        saved = 0 if before == 1 else 1
        for number, localizer in enumerate(self._localizers.values()):
            localizer.save_state(_beside(path, number, saved))
        header = {"format": _FORMAT, "maps": list(self._names), "saved": saved}
        write_arrays(path, header, {"probabilities": self._belief.probabilities})
        for number in range(len(self._names)):
            _beside(path, number, before).unlink(missing_ok=True)

    @locked
    def resume(self, path: str | Path) -> None:
        """Go on from a saved state (see `Localizer.resume`).

        Raises
        ------
        StateError
            Missing or damaged, or saved with other maps or settings. The robot may then be anywhere on all maps.
        """
        try:
            header, arrays = read_arrays(Path(path))
        except (OSError, ValueError) as error:
            raise StateError(f"{path}: not a saved state ({error}); start anew and save it again") from error
        if header.get("format") not in (_FORMAT, _FORMAT_BEFORE):
            raise StateError(f"{path}: format is {header.get('format')!r}, this version reads '{_FORMAT}'; start anew")
        if header.get("maps") != list(self._names):
            raise StateError(f"{path}: saved with maps {header.get('maps')}, these are {list(self._names)}; start anew")
        probabilities = np.asarray(arrays.get("probabilities"), dtype=np.float64)
        if probabilities.shape != (len(self._names),) or not np.isfinite(probabilities).all() or (probabilities < 0.0).any():
            raise StateError(f"{path}: the saved state is damaged (probabilities); start anew and save it again")
        try:
            for number, localizer in enumerate(self._localizers.values()):
                localizer.resume(_beside(Path(path), number, _set_of(header)))
        except StateError:
            self.relocalize()
            raise
        self._belief = FloorBelief(self._names, probabilities / max(float(probabilities.sum()), 1e-300))


def _beside(path: Path, number: int, saved: int | None) -> Path:
    return path.with_name(f"{path.stem}.{number}{'' if saved is None else f'.{saved}'}{path.suffix}")


def _set_of(header: Mapping[str, Any]) -> int | None:
    """Which of two sets of files beside a saved state holds it, 0 or 1; None where an earlier version wrote the only one."""
    return None if header.get("format") == _FORMAT_BEFORE else int(header.get("saved") == 1)


def _saved_before(path: Path) -> int | None:
    """The set that a saved state is in; 0 where nothing is saved."""
    try:
        return _set_of(read_arrays(path)[0])
    except (OSError, ValueError):
        return 0
