"""A localizer's state that outlives its program: saved now and then and at exit, taken up again at the start."""

from __future__ import annotations

import threading
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from panoloc_mcl.robot.errors import OutputError, StateError


class Keepable(Protocol):
    """A localizer on one map or on several."""

    def save_state(self, path: str | Path) -> None:
        """Save all that the next estimate depends on."""

    def resume(self, path: str | Path) -> None:
        """Go on from it."""


class StateKeeper:
    """Saves a localizer's state every so many seconds and when it is left; a thread of its own does so.

    ::

        with StateKeeper(localizer, "state.npz", every_s=10.0) as keeper:
            print(keeper.problem or "goes on where it was")

    Parameters
    ----------
    localizer : Localizer or FloorLocalizer
    path : str or Path
        An npz file; it need not exist yet. Written whole or not at all, so killing the program does not harm it.
    every_s : float
        Seconds between two savings.

    Attributes
    ----------
    resumed : bool
        Whether the localizer goes on from a saved state.
    problem : str
        Why the state could not be taken up, or not be saved the last time; empty when all is well.
    """

    def __init__(self, localizer: Keepable, path: str | Path, every_s: float = 10.0) -> None:
        self._localizer, self._path, self._every_s = localizer, Path(path), every_s
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="panoloc-state", daemon=True)
        self.resumed, self.problem = False, ""
        try:
            if self._path.exists():
                localizer.resume(self._path)
                self.resumed = True
        except StateError as error:
            self.problem = str(error)

    def save(self) -> None:
        """Save now; what goes wrong stands in `problem`, and the robot drives on."""
        try:
            self._localizer.save_state(self._path)
            self.problem = ""
        except OutputError as error:
            self.problem = str(error)

    def _run(self) -> None:
        while not self._stopped.wait(self._every_s):
            self.save()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stopped.set()
        self._thread.join()
        self.save()
