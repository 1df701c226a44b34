"""What one image tells by itself, position and heading unknown: every observation model and switch, light and corruption.

    python scripts/ablate_observation.py [--dataset PATH_OR_NAME] [--models NAME ...] [--conditions NAME ...] [--every N]
                                         [--seed SEED] [--out FOLDER]

Names of models may be patterns: 'votes' is the default alone, 'votes*' all its switches. Conditions are corruptions such as
'bars:0.7+random_pixels:0.25', or 'clean'. Prints the table as Markdown, and writes it to FOLDER/ablation/TIME as table.md and
table.csv after every model. Times are those of one thread, from panorama to pose, as a multiple of OpenCV's template matching of the
same image with all references at all headings.
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

from panoloc_mcl.camera import Panorama, Unwrapper
from panoloc_mcl.cli.monitor import Monitor, monitor
from panoloc_mcl.config import config_from_mapping
from panoloc_mcl.config.model import ObservationSettings
from panoloc_mcl.config.overrides import apply, parse_overrides
from panoloc_mcl.corruptions import Recipe, parse_recipe
from panoloc_mcl.datasets import Dataset, read_dataset, read_image, resolve_dataset
from panoloc_mcl.datasets.splice import group_of
from panoloc_mcl.errors import ConfigError, PanolocError
from panoloc_mcl.evaluation import wilson95
from panoloc_mcl.files import write_atomically
from panoloc_mcl.geometry import angle_difference
from panoloc_mcl.map_cache import cached_map

#: Name of each row of the table -> the settings under `observation` that differ from the default ones.
MODELS: dict[str, tuple[str, ...]] = {
    "votes": (),
    "votes/signed": ("votes.gradient=signed",),
    "votes/no_median": ("votes.median=false",),
    "votes/no_masks": ("votes.mask_dark=-1", "votes.mask_bright=256"),
    "votes/components_30": ("votes.components=30",),
    "votes/components_60": ("votes.components=60",),
    "votes/components_200": ("votes.components=200",),
    "votes/full_bandwidth": ("votes.bandwidth=1.0",),
    "votes/no_virtual_places": ("votes.virtual_places.enabled=false",),
    "votes/spacing_0.5": ("votes.virtual_places.spacing_m=0.5",),
    "votes/spacing_0.25": ("votes.virtual_places.spacing_m=0.25",),
    "votes/no_refinement": ("votes.refinement.enabled=false",),
    "votes/no_tilt": ("votes.refinement.tilt=false",),
    "paper": ("model=paper",),
    "paper/pixels_400": ("model=paper", "paper.pixels=400", "paper.trim_to=320"),
    "paper/pixels_2000": ("model=paper", "paper.pixels=2000", "paper.trim_to=1600"),
    "paper/hypotheses_10": ("model=paper", "paper.hypotheses=10"),
    "paper/hypotheses_100": ("model=paper", "paper.hypotheses=100"),
    "paper/trim_to_300": ("model=paper", "paper.trim_to=300"),
    "paper/no_trimming": ("model=paper", "paper.trim_to=1000"),
    "fourier_signature": ("model=fourier_signature",),
    "fourier_signature/magnitudes": ("model=fourier_signature", "fourier_signature.heading=none"),
    "eigenspace": ("model=eigenspace",),
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
    "gain:0.35",
    "gain:2.2",
)

# Tiers and the circle of a place: `panoloc_mcl.evaluation` has the same for whole runs.
TIERS = ((0.25, 3.0), (0.10, 1.0))
PASS_WITHIN_M = 0.15
# Template matching is timed on this many images of each row.
_TIMED_IMAGES = 5


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

    Errors are infinite for an image that the model finds to say nothing; those of the heading mean nothing for a model that gives
    none.
    """

    model: str
    light: str
    condition: str
    error: str = ""
    gives_heading: bool = True
    position_m: list[float] = field(default_factory=list)
    heading_deg: list[float] = field(default_factory=list)
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
            "heading median deg": _quantile(heading, 0.5, 3) if self.gives_heading else "",
        }
        for metres, degrees in TIERS:
            hits = int(np.sum((position <= metres) & (heading <= degrees)))
            figures[f"within {metres:g} m {degrees:g} deg"] = Rate(hits, len(position) if self.gives_heading else 0)
        return {
            **figures,
            f"recognised within {PASS_WITHIN_M:g} m": Rate(sum(self.recognised), len(self.recognised)),
            "says nothing": str(int(np.sum(np.isinf(position)))) if len(position) else "",
            "time / matchTemplate": f"{statistics.median(self.time_ratios):.3g}" if self.time_ratios else "",
            "error": self.error,
        }


def main(words: Sequence[str] | None = None) -> int:
    """Make the table; 0 if every row has figures, 1 if some have an error instead, 2 if nothing could be done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="room", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--models", nargs="+", default=["*"], metavar="NAME", help=f"of {', '.join(MODELS)}")
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), metavar="NAME", help="corruptions")
    parser.add_argument("--every", type=_at_least(1), default=1, metavar="N", help="use every N-th image of a sequence")
    parser.add_argument("--seed", type=_at_least(0), default=0, help="of the corruptions and of models that draw pixels")
    parser.add_argument("--out", type=Path, default=Path("results"), metavar="FOLDER")
    arguments = parser.parse_args(words)
    threads = cv2.getNumThreads()
    try:
        models = selected(arguments.models)
        recipes = [parse_recipe(text) for text in arguments.conditions]
        dataset = read_dataset(resolve_dataset(arguments.dataset))
        frames = frames_of(dataset, arguments.every)
        title = (
            f"Single images of `{dataset.name}`, position and heading unknown: {len(dataset.references)} references, "
            f"every {arguments.every}. image, seed {arguments.seed}; rates with Wilson 95 % intervals"
        )
        folder = arguments.out / "ablation" / datetime.now().strftime("%Y%m%d_%H%M%S")
        rows: list[Row] = []
        cv2.setNumThreads(1)
        with threadpool_limits(1), monitor() as watching:
            for number, name in enumerate(models):
                rows += measured(name, dataset, frames, recipes, arguments.seed, watching)
                write_atomically(folder / "table.csv", as_csv(rows))
                write_atomically(folder / "table.md", as_markdown(title, rows))
                watching.progress(number + 1, len(models), "models")
    except PanolocError as error:
        print("\n".join(f"error: {fault}" for fault in error.faults), file=sys.stderr)
        return 2
    finally:
        cv2.setNumThreads(threads)
    print(as_markdown(title, rows), end="")
    print(f"written: {folder}", file=sys.stderr)
    return 1 if any(row.error for row in rows) else 0


def selected(patterns: Sequence[str]) -> list[str]:
    """Names of the models that any pattern means, in the order of the table.

    Raises
    ------
    ConfigError
        A pattern that means none.
    """
    faults = []
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in MODELS):
            close = difflib.get_close_matches(pattern, MODELS, n=1, cutoff=0.5)
            remedy = f"did you mean '{close[0]}'?" if close else f"known: {', '.join(MODELS)}"
            faults.append(f"--models {pattern}: no such model; {remedy}")
    if faults:
        raise ConfigError(faults)
    return [name for name in MODELS if any(fnmatchcase(name, pattern) for pattern in patterns)]


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
                for index in range(0, len(drive), every)
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
        bench = Bench(dataset, settings_of(name), seed, watching)
    except Exception as error:
        return [Row(name, "all", "all", error=_told(error))]
    rows = []
    done, total = 0, len(recipes) * sum(map(len, frames.values()))
    for light, images in frames.items():
        for recipe in recipes:
            row = Row(name, light, recipe.text)
            try:
                for index, frame in enumerate(images):
                    bench.add(row, frame, recipe)
                    watching.progress(done + index + 1, total, "images")
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
    """

    def __init__(self, dataset: Dataset, settings: ObservationSettings, seed: int, watching: Monitor) -> None:
        self._map = cached_map(dataset, settings, seed, watching.progress)
        self._model = self._map.observation_model(settings)
        self._seed = seed
        self._dataset = dataset
        self._unwrappers: dict[str, Unwrapper] = {}

    def add(self, row: Row, frame: Frame, recipe: Recipe) -> None:
        """Look at one image; at the first few of a row with template matching, too."""
        panorama = self._panorama(frame, recipe)
        if not row.position_m:
            # The first call pays for what is made once.
            self._model.observe(panorama)
        begin = time.perf_counter()
        field = self._model.observe(panorama)
        pose = field.best_pose if field.measurement is None else field.measurement.pose
        seconds = time.perf_counter() - begin
        if len(row.time_ratios) < _TIMED_IMAGES:
            # One after the other, so that a busy moment of the machine strikes both.
            row.time_ratios.append(seconds / self._template_matching_seconds(panorama))
        distance = float(np.hypot(*(pose - frame.truth)[:2]))
        turn = float(np.degrees(abs(angle_difference(pose[2], frame.truth[2]))))
        row.position_m.append(distance if field.informative else np.inf)
        row.heading_deg.append(turn if field.informative else np.inf)
        row.gives_heading = self._model.gives_heading
        references = self._map.references.positions
        from_references = np.hypot(*(references - frame.truth[:2]).T)
        if from_references.min() <= PASS_WITHIN_M:
            # A model of the references alone names one; others give a pose, and the reference nearest to it.
            places = field.places
            reported = field.peak.place if places.references is None else places.nearest_reference(pose[:2])
            # By distance, not by index: references taken at one spot are one place.
            same = from_references[reported] <= from_references.min() + 1e-9
            row.recognised.append(field.informative and bool(same))

    def _panorama(self, frame: Frame, recipe: Recipe) -> Panorama:
        if frame.sequence not in self._unwrappers:
            drive = self._dataset.sequences[frame.sequence]
            self._unwrappers[frame.sequence] = self._map.unwrapper(drive.camera, drive.image_size)
        panorama = self._unwrappers[frame.sequence](read_image(frame.file))
        if not recipe.changes_images:
            return panorama
        # Every model gets the same corrupted images.
        rng = np.random.default_rng([self._seed, frame.number, zlib.crc32(recipe.text.encode())])
        geometry = self._map.geometry
        field_deg = geometry.elevation_top_deg - geometry.elevation_bottom_deg
        grey = np.clip(np.rint(panorama.pixels), 0.0, 255.0).astype(np.uint8)
        pixels = recipe.image(grey, rng, field_deg).astype(np.float32)
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
