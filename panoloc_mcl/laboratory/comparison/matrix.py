"""The matrix of a comparison: a YAML file of axes, and the cells that they span."""

from __future__ import annotations

import fnmatch
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, JsonValue

from panoloc_mcl.laboratory.corruptions import parse_recipe
from panoloc_mcl.laboratory.corruptions.recipe import CLEAN
from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.robot.settings.validation import StrictModel, read_yaml, validate
from panoloc_mcl.tools.config import Override, RunConfig, config_from_mapping
from panoloc_mcl.tools.config.overrides import parse_overrides
from panoloc_mcl.tools.datasets import Dataset
from panoloc_mcl.tools.datasets.references.thinning import ALL, check_part
from panoloc_mcl.tools.evaluation.record import group_of

#: First line of a matrix: tells it from a run configuration.
FORMAT = "panoloc-comparison/1"

Settings = dict[str, JsonValue]
Labelled = Annotated[dict[str, Settings], Field(min_length=1)]
Names = Annotated[list[str], Field(min_length=1)]
Seeds = Annotated[list[Annotated[int, Field(ge=0, lt=2**63)]], Field(min_length=1)]


class Part(StrictModel):
    """Axes of one part of a matrix; those left out are the matrix's own."""

    datasets: Names | None = Field(None, description="As `datasets` of the matrix.")
    lights: Literal["all"] | Names | None = Field(None, description="As `lights` of the matrix.")
    corruptions: Names | None = Field(None, description="As `corruptions` of the matrix.")
    references: Names | None = Field(None, description="As `references` of the matrix.")
    every: Annotated[int, Field(ge=1)] | None = Field(None, description="As `every` of the matrix.")


class Matrix(StrictModel):
    """Data sets x lights x corruptions x references x observation models x modes x variants x seeds."""

    format: Literal["panoloc-comparison/1"] = Field(description="Says that this is a matrix, not the configuration of one run.")
    name: str = Field(
        min_length=1, max_length=80, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", description="Folder name under `--out`."
    )
    description: str = Field("", description="What is asked; stands above the summary.")
    base: Settings = Field(default_factory=dict, description="Keys of a run configuration that all cells share.")
    datasets: Names = Field(["hall"], description="Paths of data sets, or names of embedded ones.")
    lights: Literal["all"] | Names = Field(
        "all",
        description="Groups of sequences (names up to the last underscore) or globs of them; each is a condition of its own.",
    )
    frames: Annotated[int, Field(ge=1)] | None = Field(
        None, description="Only so many frames of each sequence, the first ones; null = all."
    )
    every: Annotated[int, Field(ge=1)] = Field(1, description="Only every so many-th of these frames.")
    corruptions: Names = Field(
        [CLEAN], description="Recipes such as `clean`, `bars:0.7+random_pixels:0.25`, `body:strong` or `everything:mild`."
    )
    references: Names = Field([ALL], description="Parts of the references: all, checkerboard, fourth, every-2m.")
    parts: Annotated[dict[str, Part], Field(min_length=1)] | None = Field(
        None,
        description="Parts, under names of your own, with axes instead of those above: so that not every corruption meets every "
        "light. Every method runs on each.",
    )
    single_images: bool = Field(
        False,
        description="Every image by itself, nothing known: no odometry and no filter. The table is one of images, not of runs.",
    )
    observations: Names | Labelled = Field(
        ["votes"],
        description="Names of observation models, or names of your own with settings below `observation`, and `map` with those of "
        "its map.",
    )
    modes: Names | Labelled = Field(
        ["monte_carlo"], description="Values of `localizer.mode`, or names of your own with settings below `localizer`."
    )
    variants: Labelled = Field({"default": {}}, description="Names of your own with dotted keys of a run configuration.")
    seeds: Annotated[int, Field(ge=1, le=1_000_000)] | Seeds = Field(
        1, description="How many seeds from `base.seed` on, or a list of them. Each is a run over each sequence."
    )
    baseline: str | None = Field(
        None, description="Method that the others are paired with, as the tables name it; null = the first."
    )

    @property
    def pieces(self) -> list[Matrix]:
        """The parts, each a matrix without parts; this one where there are none."""
        if self.parts is None:
            return [self]
        given = [part.model_dump(exclude_none=True) for part in self.parts.values()]
        return [self.model_copy(update={**axes, "parts": None}) for axes in given]

    @property
    def all_datasets(self) -> list[str]:
        """Data sets of all parts, each once."""
        return list(dict.fromkeys(name for piece in self.pieces for name in piece.datasets))


@dataclass(frozen=True, eq=False)
class Cell:
    """One field of the matrix: everything that its figures depend on, but the data themselves.

    Parameters
    ----------
    condition : mapping of str to str
        dataset, light, corruption: what the robot meets.
    method : mapping of str to str
        references, observation, mode, variant: what it does about it.
    seed : int
    config : RunConfig
        Resolved; its sequences are those of the light, and it runs once.
    frames : int or None
    every : int
    alone : bool
        Single images, without a filter.
    """

    condition: Mapping[str, str]
    method: Mapping[str, str]
    seed: int
    config: RunConfig
    frames: int | None = None
    every: int = 1
    alone: bool = False

    @property
    def axes(self) -> dict[str, str | int]:
        """Condition, method and seed in one."""
        return {**self.condition, **self.method, "seed": self.seed}


def is_matrix(path: Path) -> bool:
    """Whether a YAML file says that it is a matrix.

    Raises
    ------
    ConfigError
        It cannot be read.
    """
    return "format" in read_yaml(path)


def load_matrix(path: Path) -> Matrix:
    """Read a matrix and check all that can be checked without the data sets; faults as `matrix_from_mapping` finds them."""
    return matrix_from_mapping(read_yaml(path), str(path))


def matrix_from_mapping(data: Mapping[str, Any], source: str = "matrix") -> Matrix:
    """Check a matrix given as plain data.

    Raises
    ------
    ConfigError
        As `load_matrix`; ``source`` names the data.
    """
    matrix = validate(Matrix, data, source)
    faults: dict[str, None] = {}
    for piece in matrix.pieces:
        for check, axis, words in (
            (parse_recipe, "corruptions", piece.corruptions),
            (check_part, "references", piece.references),
        ):
            for word in words:
                try:
                    check(word)
                except PanolocError as error:
                    faults.update(dict.fromkeys(f"{source}: {axis}: {fault}" for fault in error.faults))
        for axis in ("datasets", "corruptions", "references", "observations", "modes", "lights", "seeds"):
            entries = getattr(piece, axis)
            if isinstance(entries, list):
                doubles = sorted({str(entry) for entry in entries if entries.count(entry) > 1})
                faults.update(dict.fromkeys(f"{source}: {axis}: '{double}' is given twice; drop one" for double in doubles))
    if faults:
        raise ConfigError(faults)
    # Every combination is resolved once, so that a key that one of them gets wrong is told before anything runs.
    _resolved(matrix, source)
    return matrix


def expand(matrix: Matrix, datasets: Mapping[str, Dataset], source: str = "matrix") -> list[Cell]:
    """The cells of a matrix, in the order of its axes, seeds last.

    Parameters
    ----------
    matrix : Matrix
    datasets : mapping of str to Dataset
        Each of ``matrix.datasets``, read.
    source : str
        What to call the matrix in a fault.

    Raises
    ------
    ConfigError
        No cells, or a light that no data set has.
    """
    if matrix.parts is not None:
        found = [
            cell for piece in matrix.pieces for cell in expand(piece, {name: datasets[name] for name in piece.datasets}, source)
        ]
        return list({tuple(cell.axes.values()): cell for cell in found}.values())
    resolved = _resolved(matrix, source)
    lights = {name: _lights(matrix, dataset) for name, dataset in datasets.items()}
    if matrix.lights != "all":
        there = [light for groups in lights.values() for light in groups]
        known = sorted({group_of(name) for dataset in datasets.values() for name in dataset.sequences})
        missing = [pattern for pattern in matrix.lights if not fnmatch.filter(there, pattern)]
        if missing:
            raise ConfigError(
                f"{source}: lights: '{pattern}' fits no group of sequences; there are: {', '.join(known)}"
                for pattern in missing
            )
    labels = _dataset_labels(datasets)
    cells = [
        Cell(
            {"dataset": labels[name], "light": light, "corruption": corruption},
            {"references": part, **method},
            seed,
            config.model_copy(update={"dataset": _findable(name, dataset), "sequences": sequences, "seed": seed, "runs": 1}),
            matrix.frames,
            matrix.every,
            matrix.single_images,
        )
        for name, dataset in datasets.items()
        for light, sequences in lights[name].items()
        for corruption in matrix.corruptions
        for part in matrix.references
        for method, config in resolved
        for seed in _seeds(matrix, config)
    ]
    if not cells:
        raise ConfigError(f"{source}: has no cells: its data sets have no sequences; add some under sequences/")
    return cells


def cells_of_run(config: RunConfig, label: str, dataset: Dataset) -> list[Cell]:
    """A run configuration as one method of a comparison: its sequences by light, its runs as seeds.

    Raises
    ------
    DatasetError, ConfigError
        Sequences that there are not.
    """
    groups: dict[str, list[str]] = {}
    for drive in dataset.select(config.sequences):
        groups.setdefault(group_of(drive.name), []).append(drive.name)
    if not groups:
        raise ConfigError(f"{label}: data set {dataset.name} has no sequences; add some under sequences/")
    method = {"references": ALL, "observation": config.observation.model, "mode": config.localizer.mode, "variant": label}
    update = {"dataset": _findable(config.dataset, dataset), "runs": 1}
    return [
        Cell(
            {"dataset": dataset.name, "light": light, "corruption": CLEAN},
            method,
            seed,
            config.model_copy(update={**update, "sequences": sequences, "seed": seed}),
        )
        for light, sequences in groups.items()
        for seed in range(config.seed, config.seed + config.runs)
    ]


def _resolved(matrix: Matrix, source: str) -> list[tuple[dict[str, str], RunConfig]]:
    """Method and configuration of every combination of observation, mode and variant.

    Raises
    ------
    ConfigError
        Keys or values that a run configuration does not take, none twice.
    """
    faults: dict[str, None] = {}
    found = []
    # What every image says by itself is compared, too, so it is not told where the robot is expected.
    base = matrix.base.get("localizer")
    asked = {} if isinstance(base, Mapping) and "tracking" in base else {"tracking": False}
    for (observation, seeing), (mode, moving), (variant, varied) in itertools.product(
        _labelled(matrix.observations), _labelled(matrix.modes), matrix.variants.items()
    ):
        models = ObservationSettings.model_fields
        mapping, seeing = seeing.get("map", {}), {key: value for key, value in seeing.items() if key != "map"}
        overrides = [
            *_overrides("observation", {"model": observation, **seeing}, f"{source}: observations.{observation}"),
            *_overrides("map", mapping if isinstance(mapping, Mapping) else {}, f"{source}: observations.{observation}.map"),
            *_overrides("localizer", {"mode": mode, **asked, **moving}, f"{source}: modes.{mode}"),
            *(Override(key, value, f"{source}: variants.{variant}") for key, value in varied.items()),
        ]
        if "model" in seeing and observation in models and seeing["model"] != observation:
            faults[f"{source}: observations.{observation}: model = {seeing['model']!r}; name it otherwise"] = None
        try:
            config = config_from_mapping(_copied(matrix.base), f"{source}: base", parse_overrides(overrides))
        except ConfigError as error:
            faults.update(dict.fromkeys(error.faults))
        else:
            found.append(({"observation": observation, "mode": mode, "variant": variant}, config))
    for key, other in (("dataset", "datasets"), ("runs", "seeds"), ("out", "--out")):
        if key in matrix.base:
            faults[f"{source}: base: key '{key}' has no place here; use {other}"] = None
    if faults:
        raise ConfigError(faults)
    return found


def _labelled(axis: Sequence[str] | Mapping[str, Settings]) -> Iterator[tuple[str, Settings]]:
    yield from axis.items() if isinstance(axis, Mapping) else ((name, {}) for name in axis)


def _overrides(prefix: str, settings: Mapping[str, Any], source: str) -> Iterator[Override]:
    """Nested settings as overrides of single keys, so that each fault names where it was written."""
    for key, value in settings.items():
        if isinstance(value, Mapping) and value and key != "initial":
            yield from _overrides(f"{prefix}.{key}", value, source)
        else:
            yield Override(f"{prefix}.{key}", value, source)


def _copied(value: Any) -> Any:
    return {key: _copied(entry) for key, entry in value.items()} if isinstance(value, Mapping) else value


def _lights(matrix: Matrix, dataset: Dataset) -> dict[str, list[str]]:
    """The names of the sequences of each light of a data set."""
    wanted = matrix.base.get("sequences", "all")
    patterns = wanted if isinstance(wanted, list) else [wanted]
    groups: dict[str, list[str]] = {}
    for name in dataset.sequences:
        light = group_of(name)
        chosen = any(pattern == "all" or fnmatch.fnmatch(name, str(pattern)) for pattern in patterns)
        if chosen and (matrix.lights == "all" or any(fnmatch.fnmatch(light, pattern) for pattern in matrix.lights)):
            groups.setdefault(light, []).append(name)
    return groups


def _dataset_labels(datasets: Mapping[str, Dataset]) -> dict[str, str]:
    """Data sets by their own names, or as they were given where two share one."""
    names = [dataset.name for dataset in datasets.values()]
    return {given: dataset.name if names.count(dataset.name) == 1 else given for given, dataset in datasets.items()}


def _findable(given: str, dataset: Dataset) -> str:
    """Embedded data sets by name, others by their whole path: a worker may have another working folder."""
    return str(dataset.path.resolve()) if (Path(given).expanduser() / "dataset.yaml").is_file() else given


def _seeds(matrix: Matrix, config: RunConfig) -> Sequence[int]:
    return matrix.seeds if isinstance(matrix.seeds, list) else range(config.seed, config.seed + matrix.seeds)
