"""What one image tells by itself, position and heading unknown: every observation model and switch, light and corruption.

    python scripts/ablate_observation.py [--dataset PATH_OR_NAME] [--models NAME ...] [--switches NAME ...]
                                         [--conditions NAME ...] [--every N] [--seed SEED] [--out FOLDER]
    python scripts/ablate_observation.py --summary TABLE.csv ...

Names may be patterns; `--switches none` leaves the models as they are. Conditions are corruptions such as
'bars:0.7+random_pixels:0.25', or 'clean'. Writes the table to FOLDER/ablation/TIME after every model, as table.md and table.csv, and
the short table of the README as readme.md, which is printed, too; with `--summary` that is all, made of the tables of earlier
runs, so that parts of the work can run side by side. Times are those of one thread, from panorama to pose, under the first
condition, as a multiple of OpenCV's template matching of the same image with all references at all headings.

On two cores that did other things, too, a row of the default model took two minutes for 45 images under all ten conditions, one of the
others half a minute.
"""

from __future__ import annotations

import argparse
import csv
import difflib
import io
import statistics
import sys
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from fnmatch import fnmatchcase
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from panoloc_mcl.laboratory.corruptions import Recipe, parse_recipe
from panoloc_mcl.laboratory.corruptions.recipe import CLEAN
from panoloc_mcl.robot.camera import Panorama, Unwrapper
from panoloc_mcl.robot.errors import ConfigError, PanolocError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.tools.cli.monitor import Monitor, monitor
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.config.overrides import apply, parse_overrides
from panoloc_mcl.tools.datasets import Dataset, read_dataset, read_image, resolve_dataset
from panoloc_mcl.tools.datasets.splice import group_of
from panoloc_mcl.tools.evaluation import wilson95
from panoloc_mcl.tools.runs.map_cache import cached_map

#: Name of each row of the table -> the settings under `observation` that differ from the default ones.
MODELS: dict[str, tuple[str, ...]] = {
    "votes": (),
    "votes/signed": ("votes.gradient=signed",),
    "votes/linear": ("votes.gradient=linear",),
    "votes/contrast_floor_1": ("votes.contrast_floor=1",),
    "votes/contrast_floor_16": ("votes.contrast_floor=16",),
    "votes/smoothing_0": ("votes.smoothing_px=0",),
    "votes/smoothing_2": ("votes.smoothing_px=2",),
    "votes/no_median": ("votes.median=false",),
    "votes/no_masks": ("votes.mask_dark=-1", "votes.mask_bright=256"),
    "votes/components_30": ("votes.components=30",),
    "votes/components_60": ("votes.components=60",),
    "votes/components_200": ("votes.components=200",),
    "votes/full_bandwidth": ("votes.bandwidth=1.0",),
    "votes/bandwidth_0.15": ("votes.bandwidth=0.15",),
    "votes/no_virtual_places": ("votes.virtual_places.enabled=false",),
    "votes/spacing_0.5": ("votes.virtual_places.spacing_m=0.5",),
    "votes/spacing_0.25": ("votes.virtual_places.spacing_m=0.25",),
    "votes/no_refinement": ("votes.refinement.enabled=false",),
    "votes/no_tilt": ("votes.refinement.tilt=false",),
    "votes/view_sources_1": ("votes.virtual_places.sources=1", "votes.refinement.sources=1"),
    "votes/view_sources_4": ("votes.virtual_places.sources=4", "votes.refinement.sources=4"),
    "paper": ("model=paper",),
    "paper/known_heading": ("model=paper",),
    "paper/steerable": ("model=paper", "paper.filters=steerable"),
    "paper/components_30": ("model=paper", "paper.components=30"),
    "paper/pixels_400": ("model=paper", "paper.pixels=400", "paper.trim_to=320"),
    "paper/pixels_2000": ("model=paper", "paper.pixels=2000", "paper.trim_to=1600"),
    "paper/hypotheses_10": ("model=paper", "paper.hypotheses=10"),
    "paper/hypotheses_100": ("model=paper", "paper.hypotheses=100"),
    "paper/trim_to_300": ("model=paper", "paper.trim_to=300"),
    "paper/no_trimming": ("model=paper", "paper.trim_to=1000"),
    "fourier_signature": ("model=fourier_signature",),
    "fourier_signature/magnitudes": ("model=fourier_signature", "fourier_signature.heading=none"),
    "eigenspace": ("model=eigenspace",),
    "eigenspace/components_30": ("model=eigenspace", "eigenspace.components=30"),
    "eigenspace/raw_energy": ("model=eigenspace", "eigenspace.unit_energy=false"),
    "least_squares": ("model=least_squares",),
    "least_squares/mean_column": ("model=least_squares", "least_squares.mean_column=true"),
    "spinning": ("model=spinning",),
    "spinning/raw_energy": ("model=spinning", "spinning.unit_energy=false"),
    "zero_phase": ("model=zero_phase",),
    "zero_phase/raw_energy": ("model=zero_phase", "zero_phase.unit_energy=false"),
    "orientation_correlation": ("model=orientation_correlation",),
}

CONDITIONS = (
    "clean",
    "bars:0.7",
    "random_pixels:0.5",
    "bars:0.5+random_pixels:0.25",
    "spatial_light",
    "tilt:2",
    "tilt:4",
    "blur:2",
    "gain:0.35",
    "gain:2.2",
)

# Tiers and the circle of a place: `panoloc_mcl.tools.evaluation` has the same for whole runs.
TIERS = ((0.25, 3.0), (0.10, 1.0))
PASS_WITHIN_M = 0.15
WITHIN = f"within {TIERS[0][0]:g} m {TIERS[0][1]:g} deg"
NEAREST = "nearest place"
# Instead of a heading error.
PLACE_ALONE = "place alone"
# Template matching is timed on this many images of each light.
_TIMED_IMAGES = 5
# Rows of which the model is told the true heading, as it was made for.
_HEADING_GIVEN = ("paper/known_heading",)

#: Rows of the short table: the default, what tells most about it, and what it is compared with.
SUMMARY = (
    "votes",
    "votes/signed",
    "votes/linear",
    "votes/no_median",
    "votes/no_masks",
    "votes/components_30",
    "votes/no_refinement",
    "votes/spacing_0.5",
    "votes/no_virtual_places",
    "paper",
    "paper/known_heading",
    "fourier_signature",
    "eigenspace",
    "least_squares",
    "least_squares/mean_column",
    "spinning",
    "zero_phase",
    "orientation_correlation",
)


@dataclass(frozen=True)
class Rate:
    """So many of so many, with the Wilson 95 % interval; empty for no trials."""

    hits: int
    trials: int

    def csv(self) -> list[str]:
        """Rate and both ends of the interval, shares."""
        interval = wilson95(self.hits, self.trials)
        return ["", "", ""] if interval is None else [f"{share:.4f}" for share in (self.hits / self.trials, *interval)]

    def markdown(self) -> str:
        """In per cent, with the number of trials."""
        interval = wilson95(self.hits, self.trials)
        if interval is None:
            return ""
        low, high = (100.0 * share for share in interval)
        return f"{100.0 * self.hits / self.trials:.1f} % of {self.trials} ({low:.1f} to {high:.1f})"


@dataclass(frozen=True)
class Frame:
    """An image and where it was taken: ground truth pose (3,), and its position in the data set for the random numbers."""

    number: int
    file: Path
    sequence: str
    truth: NDArray[np.float64]


@dataclass
class Row:
    """One line of the table.

    Errors are infinite for an image that the model finds to say nothing. A model that gives no heading is judged by the place alone.
    """

    model: str
    light: str
    condition: str
    error: str = ""
    gives_heading: bool = True
    position_m: list[float] = field(default_factory=list)
    heading_deg: list[float] = field(default_factory=list)
    nearest: list[bool] = field(default_factory=list)
    recognised: list[bool] = field(default_factory=list)
    time_ratios: list[float] = field(default_factory=list)

    def figures(self) -> dict[str, str | Rate]:
        """All columns of the table, by name."""
        position, heading = np.array(self.position_m), np.array(self.heading_deg)
        figures: dict[str, str | Rate] = {
            "model": self.model,
            "light": self.light,
            "condition": self.condition,
            "n": str(len(position)),
            "position median m": _quantile(position, 0.5, 4),
            "position p95 m": _quantile(position, 0.95, 4),
            "heading median deg": _quantile(heading, 0.5, 3) if self.gives_heading else PLACE_ALONE,
        }
        for metres, degrees in TIERS:
            turned_right = (heading <= degrees) | (not self.gives_heading)
            hits = int(np.sum((position <= metres) & turned_right))
            figures[f"within {metres:g} m {degrees:g} deg"] = Rate(hits, len(position))
        return {
            **figures,
            NEAREST: Rate(sum(self.nearest), len(self.nearest)),
            f"recognised within {PASS_WITHIN_M:g} m": Rate(sum(self.recognised), len(self.recognised)),
            "says nothing": str(int(np.sum(np.isinf(position)))) if len(position) else "",
            "time / matchTemplate": f"{statistics.median(self.time_ratios):.3g}" if self.time_ratios else "",
            "error": self.error,
        }


def main(words: Sequence[str] | None = None) -> int:
    """Make the table; 0 if every row has figures, 1 if some have an error instead, 2 if nothing could be done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument(
        "--models", nargs="+", default=["*"], metavar="NAME", help=f"of {', '.join(dict.fromkeys(map(_model, MODELS)))}"
    )
    parser.add_argument(
        "--switches",
        nargs="+",
        default=["*"],
        metavar="NAME",
        help=f"of {', '.join(filter(None, map(_switch, MODELS)))}, or none",
    )
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), metavar="NAME", help="corruptions")
    parser.add_argument("--every", type=_at_least(1), default=1, metavar="N", help="use every N-th image of a sequence")
    parser.add_argument("--seed", type=_at_least(0), default=0, help="of the corruptions and of models that draw pixels")
    parser.add_argument("--out", type=Path, default=Path("results"), metavar="FOLDER")
    parser.add_argument("--summary", nargs="+", type=Path, metavar="TABLE.csv", help="only print the short table of these")
    arguments = parser.parse_args(words)
    threads = cv2.getNumThreads()
    try:
        if arguments.summary is not None:
            print(summary_of([row for table in arguments.summary for row in read_table(table)]), end="")
            return 0
        models = selected(arguments.models, arguments.switches)
        recipes = [parse_recipe(text) for text in arguments.conditions]
        dataset = read_dataset(resolve_dataset(arguments.dataset))
        frames = frames_of(dataset, arguments.every)
        title = (
            f"Single images of `{dataset.name}`, position and heading unknown: {len(dataset.references)} references, "
            f"every {arguments.every}. image, seed {arguments.seed}; rates with Wilson 95 % intervals. Nearest place: the "
            "reference that is named is the nearest one, of all images; recognised: the same, of images within "
            f"{PASS_WITHIN_M:g} m of one. '{PLACE_ALONE}': the model gives no heading, or is given it, and all its figures are of "
            "the place"
        )
        folder = arguments.out / "ablation" / datetime.now().strftime("%Y%m%d_%H%M%S")
        rows: list[Row] = []
        cv2.setNumThreads(1)
        with threadpool_limits(1), monitor() as watching:
            for number, name in enumerate(models):
                rows += measured(name, dataset, frames, recipes, arguments.seed, watching)
                table = as_csv(rows)
                write_atomically(folder / "table.csv", table)
                write_atomically(folder / "table.md", as_markdown(title, rows))
                write_atomically(folder / "readme.md", summary_of(list(csv.DictReader(table.splitlines()))))
                watching.progress(number + 1, len(models), "models")
    except PanolocError as error:
        print("\n".join(f"error: {fault}" for fault in error.faults), file=sys.stderr)
        return 2
    finally:
        cv2.setNumThreads(threads)
    print((folder / "readme.md").read_text(encoding="utf-8"), end="")
    failed = [row for row in rows if row.error]
    for row in failed:
        print(f"error: {row.model}, {row.light}, {row.condition}: {row.error}", file=sys.stderr)
    print(f"written: {folder}", file=sys.stderr)
    return 1 if failed else 0


def selected(models: Sequence[str], switches: Sequence[str]) -> list[str]:
    """Names of the rows that the patterns mean, in the order of the table; every model itself comes with its switches.

    Raises
    ------
    ConfigError
        A pattern that means none.
    """
    known = list(dict.fromkeys(map(_model, MODELS)))
    faults = _unknown("--models", "model", models, known)
    rows = [name for name in MODELS if _fits(_model(name), models)]
    of_these = list(dict.fromkeys(filter(None, map(_switch, rows))))
    if not faults:
        # A single model may have no switches at all.
        faults = _unknown(
            "--switches", "switch of these models", [word for word in switches if word not in ("*", "none")], of_these
        )
    if faults:
        raise ConfigError(faults)
    return [name for name in rows if not _switch(name) or _fits(_switch(name), switches)]


def _model(name: str) -> str:
    return name.partition("/")[0]


def _switch(name: str) -> str:
    """Empty for a model as it is."""
    return name.partition("/")[2]


def _fits(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _unknown(option: str, what: str, patterns: Sequence[str], known: Sequence[str]) -> list[str]:
    faults = []
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in known):
            close = difflib.get_close_matches(pattern, known, n=1, cutoff=0.5)
            remedy = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(known) or 'none'}"
            faults.append(f"{option} {pattern}: no such {what}; {remedy}")
    return faults


def settings_of(model: str) -> ObservationSettings:
    """Settings of a row's model."""
    data: dict[str, object] = {}
    for override in parse_overrides([f"observation.{text}" for text in MODELS[model]]):
        apply(data, override)
    return config_from_mapping(data).observation


def frames_of(dataset: Dataset, every: int) -> dict[str, list[Frame]]:
    """Images with ground truth by light, that is, group of sequences.

    Raises
    ------
    ConfigError
        There are none.
    """
    frames: dict[str, list[Frame]] = {}
    before = 0
    for drive in dataset.sequences.values():
        if drive.groundtruth is not None:
            frames.setdefault(group_of(drive.name), []).extend(
                Frame(before + index, drive.files[index], drive.name, drive.groundtruth.at(drive.times[index]))
                # Not the first: drives may all begin at a reference.
                for index in range(min(every // 2, len(drive) - 1), len(drive), every)
            )
        before += len(drive)
    if not frames:
        raise ConfigError(f"--dataset {dataset.name}: has no sequence with ground truth; use another data set")
    return frames


def measured(
    name: str,
    dataset: Dataset,
    frames: dict[str, list[Frame]],
    recipes: Sequence[Recipe],
    seed: int,
    watching: Monitor,
) -> list[Row]:
    """The rows of one model; whatever fails becomes a row with its error.

    Parameters
    ----------
    name : str
        A key of `MODELS`.
    dataset : Dataset
    frames : dict of str to list of Frame
        By light.
    recipes : sequence of Recipe
    seed : int
    watching : Monitor
    """
    try:
        bench = Bench(dataset, settings_of(name), seed, watching, heading_given=name in _HEADING_GIVEN)
    except Exception as error:
        return [Row(name, "all", "all", error=_told(error))]
    rows = []
    done, total = 0, len(recipes) * sum(map(len, frames.values()))
    for light, images in frames.items():
        for number, recipe in enumerate(recipes):
            row = Row(name, light, recipe.text)
            try:
                for index, frame in enumerate(images):
                    bench.add(row, frame, recipe, timed=number == 0 and index < _TIMED_IMAGES)
                    watching.progress(done + index + 1, total, f"images, {name}")
            except Exception as error:
                row = Row(name, light, recipe.text, error=_told(error))
            rows.append(row)
            done += len(images)
    return rows


class Bench:
    """One observation model on its map, ready for images.

    Parameters
    ----------
    dataset : Dataset
    settings : ObservationSettings
    seed : int
    watching : Monitor
        Told how building the map goes on.
    heading_given : bool
        The model is asked about the true heading only.
    """

    def __init__(
        self, dataset: Dataset, settings: ObservationSettings, seed: int, watching: Monitor, heading_given: bool = False
    ) -> None:
        self._map = cached_map(dataset, settings, seed, watching.progress)
        self._model = self._map.observation_model(settings)
        self._seed = seed
        self._heading_given = heading_given
        self._dataset = dataset
        self._unwrappers: dict[str, Unwrapper] = {}

    def add(self, row: Row, frame: Frame, recipe: Recipe, timed: bool = False) -> None:
        """Look at one image; with template matching, too, where time is taken."""
        panorama = self._panorama(frame, recipe)
        headings = frame.truth[2:] if self._heading_given else None
        if timed and not row.position_m:
            # The first call pays for what is made once.
            self._model.observe(panorama, headings)
        begin = time.perf_counter()
        field = self._model.observe(panorama, headings)
        pose = field.best_pose if field.measurement is None else field.measurement.pose
        seconds = time.perf_counter() - begin
        if timed:
            # One after the other, so that a busy moment of the machine strikes both.
            row.time_ratios.append(seconds / self._template_matching_seconds(panorama))
        distance = float(np.hypot(*(pose - frame.truth)[:2]))
        turn = float(np.degrees(abs(angle_difference(pose[2], frame.truth[2]))))
        row.position_m.append(distance if field.informative else np.inf)
        row.heading_deg.append(turn if field.informative else np.inf)
        row.gives_heading = self._model.gives_heading and not self._heading_given
        references = self._map.references.positions
        from_references = np.hypot(*(references - frame.truth[:2]).T)
        # A model of the references alone names one; others give a pose, and the reference nearest to it.
        places = field.places
        named = field.peak.place if places.references is None else places.nearest_reference(pose[:2])
        # By distance, not by index: references taken at one spot are one place.
        right = field.informative and bool(from_references[named] <= from_references.min() + 1e-9)
        row.nearest.append(right)
        if from_references.min() <= PASS_WITHIN_M:
            row.recognised.append(right)

    def _panorama(self, frame: Frame, recipe: Recipe) -> Panorama:
        if frame.sequence not in self._unwrappers:
            drive = self._dataset.sequences[frame.sequence]
            self._unwrappers[frame.sequence] = self._map.unwrapper(drive.camera, drive.image_size)
        panorama = self._unwrappers[frame.sequence](read_image(frame.file))
        if not recipe.changes_images:
            return panorama
        # Every model gets the same corrupted images.
        rng = np.random.default_rng([self._seed, frame.number, zlib.crc32(recipe.text.encode())])
        grey = np.clip(np.rint(panorama.pixels), 0.0, 255.0).astype(np.uint8)
        pixels = recipe.image(grey, rng, self._map.geometry.elevation_deg).astype(np.float32)
        if panorama.valid is not None:
            pixels[~panorama.valid] = 0.0
        return Panorama(pixels, panorama.valid)

    def _template_matching_seconds(self, panorama: Panorama) -> float:
        """OpenCV's normalised cross-correlation with every reference at every heading."""
        image = np.clip(panorama.pixels, 0.0, 255.0).astype(np.uint8)
        wrapped = np.hstack([image, image[:, :-1]])
        begin = time.perf_counter()
        for reference in self._map.references.pixels:
            cv2.matchTemplate(wrapped, reference, cv2.TM_CCOEFF_NORMED)
        return time.perf_counter() - begin


def as_csv(rows: Sequence[Row]) -> str:
    """The table as comma-separated values; a rate takes three columns, itself and the ends of its interval."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for index, row in enumerate(rows):
        figures = row.figures().items()
        if index == 0:
            names = [[name, f"{name} low", f"{name} high"] if isinstance(value, Rate) else [name] for name, value in figures]
            writer.writerow([name for part in names for name in part])
        cells = [value.csv() if isinstance(value, Rate) else [value] for _, value in figures]
        writer.writerow([cell for part in cells for cell in part])
    return text.getvalue()


def as_markdown(title: str, rows: Sequence[Row]) -> str:
    """The table as Markdown, without an empty column of errors."""
    table = [row.figures() for row in rows]
    if not any(row.error for row in rows):
        for figures in table:
            del figures["error"]
    lines = [list(table[0]), ["---"] * len(table[0])]
    for figures in table:
        cells = [value.markdown() if isinstance(value, Rate) else value for value in figures.values()]
        lines.append([cell.replace("|", "\\|") for cell in cells])
    return f"{title}.\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines)


def read_table(path: Path) -> list[dict[str, str]]:
    """Rows of a table.csv.

    Raises
    ------
    ConfigError
        It cannot be read, or is none.
    """
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"--summary {path}: cannot be read ({error}); name a table.csv of an earlier run") from error
    if not rows or not {"model", "light", "condition", "n", WITHIN, NEAREST} <= set(rows[0]):
        raise ConfigError(f"--summary {path}: not a table of this script; name a table.csv of an earlier run")
    return rows


def summary_of(rows: Sequence[dict[str, str]]) -> str:
    """The short table of the README, as Markdown, from rows of table.csv; of two of the same name, the later one counts."""
    table = {(row["model"], row["light"], row["condition"]): row for row in rows if not row.get("error")}
    lights = sorted({light for _, light, condition in table if condition == CLEAN})
    conditions = list(dict.fromkeys(condition for _, _, condition in table if condition != CLEAN))
    lines = [["model", "images a light", *(f"{CLEAN}, {light}" for light in lights), *conditions]]
    lines.append(["---"] * len(lines[0]))
    for model in [name for name in SUMMARY if any(name == key[0] for key in table)]:
        cells = []
        for light in lights:
            row = table.get((model, light, CLEAN))
            cells.append(f"{1000 * float(row['position median m']):.1f} mm, {_short([row])}" if row else "")
        for condition in conditions:
            cells.append(_short([row for key, row in table.items() if key[0] == model and key[2] == condition]))
        of_model = [row for key, row in table.items() if key[0] == model]
        name = f"{model} *" if any(row["heading median deg"] == PLACE_ALONE for row in of_model) else model
        lines.append([name, "–".join(sorted({row["n"] for row in of_model}, key=int)), *cells])
    text = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    said = (
        f"Each cell: share of the images within {TIERS[0][0]:g} m and {TIERS[0][1]:g} degrees / share whose nearest reference is "
        f"named, in per cent; for clean images, the median position error before it"
    )
    starred = " * gives no heading, or is given it: judged by the place alone." if " * |" in text else ""
    return f"{said}.{starred}\n\n{text}"


def _short(rows: Sequence[dict[str, str]]) -> str:
    """Both rates over all lights, in per cent."""
    counts = np.array([int(row["n"]) for row in rows])
    if not counts.sum():
        return ""
    shares = (np.dot(counts, [float(row[name]) for row in rows]) / counts.sum() for name in (WITHIN, NEAREST))
    return " / ".join(f"{100 * share:.0f}" for share in shares)


def _quantile(values: NDArray[np.float64], share: float, digits: int) -> str:
    # Without interpolation, which cannot stand infinite errors.
    return f"{np.quantile(values, share, method='inverted_cdf'):.{digits}f}" if len(values) else ""


def _told(error: Exception) -> str:
    """An error in one line."""
    text = "; ".join(error.faults) if isinstance(error, PanolocError) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())


def _at_least(lowest: int) -> Callable[[str], int]:
    def whole_number(text: str) -> int:
        value = int(text)
        if value < lowest:
            raise argparse.ArgumentTypeError(f"{value}: must be at least {lowest}")
        return value

    return whole_number


if __name__ == "__main__":
    sys.exit(main())
