"""Where a soak stands, on disk: one that was stopped goes on there."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from panoloc_mcl.laboratory.studies.robustness.soak.findings import Findings
from panoloc_mcl.laboratory.studies.robustness.soak.world import World
from panoloc_mcl.robot.errors import StateError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.source import source_digest

#: What counts depend on, beside data and settings.
_SOURCE = ("robot/", "laboratory/studies/robustness/soak/")


class Place:
    """The files of one soak in a folder: counts and the world, and beside them the localizer's state.

    Parameters
    ----------
    folder : Path
    description : iterable
        All that the counts depend on besides the source; its text counts. A soak with another description does not go on here.
    """

    def __init__(self, folder: Path, description: Iterable[object]) -> None:
        text = json.dumps([source_digest(_SOURCE), *map(str, description)])
        self._folder, self._key = folder, hashlib.sha256(text.encode()).hexdigest()[:24]
        self._file = folder / f"{self._key}.json"

    def take_up(self, localizer: Localizer, world: World) -> Findings:
        """Bring both to where they were, and give the counts; nothing changes, and there are none, if nothing was kept."""
        try:
            kept = json.loads(self._file.read_text(encoding="utf-8"))
            found = Findings.of_data(kept["findings"])
            localizer.load_state(self._folder / kept["state"])
        except (OSError, ValueError, KeyError, TypeError, StateError):
            # Never begun, or of a disk that was full: from the beginning.
            return Findings()
        world.restore(kept["world"])
        return found

    def keep(self, localizer: Localizer, world: World, found: Findings) -> None:
        """Write where they are; a process that is killed meanwhile leaves what was kept before.

        Raises
        ------
        OutputError
            A file cannot be written.
        """
        state = f"{self._key}-{found.updates}.npz"
        localizer.save_state(self._folder / state)
        write_atomically(self._file, json.dumps({"findings": found.data(), "world": world.snapshot(), "state": state}))
        for old in self._folder.glob(f"{self._key}-*.npz"):
            if old.name != state:
                old.unlink(missing_ok=True)
