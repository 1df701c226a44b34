"""One row of the study with one seed: the maps that it asks for, and their figures, kept under the hash of all they depend on."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from panoloc_mcl.laboratory.comparison.cell import data_digest
from panoloc_mcl.laboratory.simulation.drive import reported
from panoloc_mcl.laboratory.simulation.settings import Odometry
from panoloc_mcl.laboratory.studies.mapping.judging import Values, judged_keyframes, localized
from panoloc_mcl.laboratory.studies.mapping.surveys import SURVEYS, disturbed
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.files import cache_folder, write_atomically
from panoloc_mcl.robot.map.drives.mapping import map_drives
from panoloc_mcl.robot.map.keyframes import Keyframes
from panoloc_mcl.robot.map.mending import mend
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.map.updating import update_map
from panoloc_mcl.robot.observation import build_settings
from panoloc_mcl.robot.progress import Progress
from panoloc_mcl.robot.source import OF_MAPS, source_digest
from panoloc_mcl.robot.unfinished import remove_parts
from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.runs.map_drives import drives_of

# What figures depend on beside the maps.
_OF_CELLS = (*OF_MAPS, "robot/filters/", "robot/localizer.py", "robot/motion/", "laboratory/studies/mapping/")
_REFERENCES = "references"


@dataclass(frozen=True)
class Row:
    """One way to make a map.

    Parameters
    ----------
    text : str
        As it was asked for: a kind of survey, or what `parsed` reads.
    """

    text: str

    @classmethod
    def parsed(cls, text: str) -> Row:
        """A survey's name, ``drives:NAME+…``, or ``update:BASE+LATER``.

        Raises
        ------
        ConfigError
            Something else.
        """
        kind, _, names = text.partition(":")
        if text in SURVEYS or (names and (kind == "drives" or (kind == "update" and names.count("+") == 1))):
            return cls(text)
        raise ConfigError(
            f"--rows {text}: no such row; known: {', '.join(SURVEYS)}, drives:NAME+NAME…, update:BASE+LATER (drives, or references)"
        )

    @property
    def updates(self) -> bool:
        """Whether a map is brought up to date."""
        return self.text.startswith("update:")

    @property
    def drives(self) -> list[str]:
        """Names of the drives that it is made of."""
        return self.text.partition(":")[2].split("+") if ":" in self.text else []

    @property
    def told(self) -> str:
        """For the table."""
        return SURVEYS[self.text][0] if self.text in SURVEYS else self.text


def cell(config: RunConfig, dataset: Dataset, row: Row, seed: int, every: int, progress: Progress) -> Values:
    """The figures of one row and seed, from the cache if they are there.

    Parameters
    ----------
    config, every
        As `study`.
    dataset : Dataset
    row : Row
    seed : int
    progress : callable (done, total, what)
    """
    path = _kept(config, dataset, row, seed, every, "json")
    if path.is_file():
        kept: Values = json.loads(path.read_text(encoding="utf-8"))
        return kept
    begin = time.process_time()
    if every == 0:
        keyframes, wrong, notes = _keyframes(config, dataset, row, seed, progress)
        figures, _ = judged_keyframes(keyframes, dataset, wrong)
        values: Values = {"seconds": time.process_time() - begin, "maps": {"": figures | {"localized": {}, "notes": notes}}}
        write_atomically(path, json.dumps(values))
        return values
    drives = [d for d in dataset.select(config.sequences) if d.groundtruth is not None and d.name not in row.drives]
    maps, wrong = _maps(config, dataset, row, seed, progress)
    values = {"seconds": time.process_time() - begin, "maps": {}}
    for name, (panorama_map, said) in maps.items():
        figures, frame = judged_keyframes(panorama_map.keyframes, dataset, wrong)
        of_drives = {drive.name: localized(config, panorama_map, drive, every, frame) for drive in drives}
        values["maps"][name] = figures | {"localized": of_drives, "notes": list(said)}
        progress(len(values["maps"]), len(maps), f"localized in the maps of {row.text}")
    write_atomically(path, json.dumps(values))
    return values


def _keyframes(
    config: RunConfig, dataset: Dataset, row: Row, seed: int, progress: Progress
) -> tuple[Keyframes, list[int], list[str]]:
    """Keyframes alone, without the map that is made of them; references that were grossly wrong, and what was said."""
    votes = config.observation.votes
    if row.updates:
        raise ConfigError(f"--rows {row.text}: an update needs whole maps; give --every 1 or more")
    if row.text in SURVEYS:
        poses, wrong = disturbed(row.text, dataset.references.poses, seed)
        made = mend(replace(dataset.references, poses=poses), votes, config.map, progress)
        return made.keyframes, wrong, list(made.notes)
    made = map_drives(drives_of(_driven_again(dataset, seed), row.drives)[0], votes, config.map, progress)
    return made.keyframes, [], list(made.notes)


def _maps(
    config: RunConfig, dataset: Dataset, row: Row, seed: int, progress: Progress
) -> tuple[dict[str, tuple[PanoramaMap, tuple[str, ...]]], list[int]]:
    """Maps of a row by name with what was said of them, and references that were grossly wrong."""
    made = (config.observation, config.seed, progress, config.map)
    if row.text in SURVEYS:
        poses, wrong = disturbed(row.text, dataset.references.poses, seed)
        built = PanoramaMap.build(replace(dataset, references=replace(dataset.references, poses=poses)), *made)
        return {"": (built, built.notes)}, wrong
    erring = _driven_again(dataset, seed)

    def of(names: Sequence[str]) -> PanoramaMap:
        path = _kept(config, dataset, Row(f"drives:{'+'.join(names)}"), seed, None, "panomap")
        if path.is_file():
            return PanoramaMap.load(path)
        if names == [_REFERENCES]:
            built = PanoramaMap.build(dataset, *made)
        else:
            # What was stopped goes on.
            parts = path.with_suffix(".parts")
            built = PanoramaMap.of_drives(dataset.name, drives_of(erring, names)[0], *made, unfinished=parts)
            remove_parts(parts)
        built.save(path)
        return built

    if not row.updates:
        built = of(row.drives)
        return {"": (built, built.notes)}, []
    base, later = row.drives
    before = of([base])
    parts = _kept(config, dataset, row, seed, None, "parts")
    done = update_map(before, drives_of(erring, [later])[0], config.map, progress, parts)
    remove_parts(parts)
    maps = {f"of {base}": (before, ()), "updated": (done.panorama_map, done.notes), f"of {later} alone": (of([later]), ())}
    return maps, []


def _driven_again(dataset: Dataset, seed: int) -> Dataset:
    """Drives with odometry that errs anew; as recorded with seed 0."""
    sequences = {}
    for name, drive in dataset.sequences.items():
        sequences[name] = drive
        if seed and drive.groundtruth is not None and drive.odometry is not None:
            rng = np.random.default_rng([seed, *name.encode()])
            sequences[name] = replace(drive, odometry=reported(drive.groundtruth, drive.odometry.times, Odometry(), rng))
    return replace(dataset, sequences=sequences)


def _kept(config: RunConfig, dataset: Dataset, row: Row, seed: int, every: int | None, kind: str) -> Path:
    """Where a cell's figures are kept, or without ``every`` a map."""
    said = {
        "code": source_digest(OF_MAPS if every is None else _OF_CELLS),
        "row": row.text,
        "seeds": [seed, config.seed],
        "map": config.map.model_dump(mode="json", exclude={"file"}),
        "localized": [every, config.sequences, config.localizer.model_dump(mode="json")] if every else None,
        "data": data_digest(dataset, config, whole=True),
        **build_settings(config.observation),
    }
    key = hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:24]
    return cache_folder() / "maps" / f"study-{key}.{kind}"
