"""What each part of an observation model is good for: every model and switch, light and corruption, over single images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from panoloc_mcl.laboratory.corruptions import Recipe, parse_recipe
from panoloc_mcl.laboratory.corruptions.recipe import CLEAN
from panoloc_mcl.laboratory.reports import Rate, Ratio, Report, Spread
from panoloc_mcl.laboratory.studies.single_images import TIERS, Frame, Verdict, Viewer, counted, frames_of
from panoloc_mcl.laboratory.timing import interleaved, one_thread, template_matching
from panoloc_mcl.robot.errors import ConfigError, PanolocError, did_you_mean
from panoloc_mcl.robot.progress import Progress, no_progress
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.datasets import Dataset, read_dataset, resolve_dataset
from panoloc_mcl.tools.evaluation.definitions import PASS_RADIUS_M
from panoloc_mcl.tools.evaluation.tables import BLANK
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
    "nearest_reference": ("model=nearest_reference",),
}
# Rows of which the model is told the true heading, as it was made for.
_HEADING_GIVEN = ("paper/known_heading",)
#: Rows of the short table: the default, what tells most about it, and what it is compared with.
SHORT = (
    *("votes", "votes/signed", "votes/linear", "votes/no_median", "votes/no_masks", "votes/components_30"),
    *("votes/no_refinement", "votes/spacing_0.5", "votes/no_virtual_places", "paper", "paper/known_heading"),
    *("fourier_signature", "eigenspace", "least_squares", "least_squares/mean_column", "spinning", "zero_phase"),
    "orientation_correlation",
    "nearest_reference",
)
#: Instead of a heading error.
PLACE_ALONE = "place alone"
WITHIN = tuple(f"within {metres:g} m, {degrees:g} degrees (95 %)" for metres, degrees in TIERS)
NEAREST, TIME = "nearest place (95 %)", "time / matchTemplate"
COLUMNS = (
    *("model", "light", "condition", "drives", "images", "position m: median / p95", "heading degrees: median", *WITHIN),
    *(NEAREST, f"recognised within {PASS_RADIUS_M:g} m (95 %)", "says nothing", TIME, "error"),
)
# Template matching is timed on this many images of each light.
_TIMED_IMAGES = 5


@dataclass
class Row:
    """One line of the table. A model that gives no heading is judged by the place alone."""

    model: str
    light: str
    condition: str
    error: str = ""
    gives_heading: bool = True
    verdicts: list[Verdict] = field(default_factory=list)
    seconds: list[tuple[float, float]] = field(default_factory=list)

    def rate(self, tier: tuple[float, float]) -> Rate:
        """Share of the images within a tier."""
        metres, degrees = tier
        return Rate.over((v.drive, v.within(metres, degrees if self.gives_heading else np.inf)) for v in self.verdicts)

    def cells(self) -> tuple[Any, ...]:
        """By `COLUMNS`."""
        found = self.verdicts
        mine, theirs = zip(*self.seconds, strict=True) if self.seconds else ((), ())
        return (
            *(self.model, self.light, self.condition, len({v.drive for v in found}), len(found)),
            Spread([v.position_m for v in found], 4, (0.5, 0.95)),
            Spread([v.heading_deg for v in found], 3, (0.5,)) if self.gives_heading else PLACE_ALONE,
            *(self.rate(tier) for tier in TIERS),
            Rate.over((v.drive, v.nearest) for v in found),
            Rate.over((v.drive, v.nearest) for v in found if v.passes),
            sum(v.position_m == np.inf for v in found),
            Ratio.of(mine, theirs) if mine else None,
            self.error,
        )


def study(
    dataset: str,
    models: Sequence[str],
    conditions: Sequence[str],
    every: int = 1,
    seed: int = 0,
    progress: Progress = no_progress,
    keep: Callable[[Report], None] = lambda report: None,
) -> Report:
    """Look at every image with every model under every condition.

    Parameters
    ----------
    dataset : str
    models : sequence of str
        Keys of `MODELS`.
    conditions : sequence of str
        Corruptions, or ``clean``. Times are taken under the first: from panorama to pose on one thread, as a multiple of OpenCV's
        template matching of the same image with all references at all headings.
    every : int
        Use every so many images.
    seed : int
        Of the corruptions, and of models that draw pixels.
    progress : callable (done, total, what)
    keep : callable
        Is given the report after each model.
    """
    recipes = [parse_recipe(text) for text in conditions]
    data = read_dataset(resolve_dataset(dataset))
    frames = frames_of(data, every)
    title = (
        f"Single images of `{data.name}`, position and heading unknown: {len(data.references)} references, every {every}. image, seed "
        f"{seed}; {counted(frames)}. Intervals are over drives. Nearest place: the reference that is named is the nearest one, of all "
        f"images; recognised: the same, of images within {PASS_RADIUS_M:g} m of one. '{PLACE_ALONE}': the model gives no heading, or "
        "is given it, and all its figures are of the place"
    )
    rows: list[Row] = []
    report = Report(title)
    with one_thread():
        for number, name in enumerate(models):
            rows += measured(name, data, frames, recipes, seed, progress)
            report = report_of(title, rows)
            keep(report)
            progress(number + 1, len(models), "models")
    return report


def report_of(title: str, rows: Sequence[Row]) -> Report:
    """The short table, and the one with all figures."""
    report = Report(title)
    usable = [row for row in rows if not row.error]
    lights = sorted({row.light for row in usable if row.condition == CLEAN})
    conditions = list(dict.fromkeys(row.condition for row in usable if row.condition != CLEAN))
    table = report.table(
        "In short",
        ("model", "drives, images", *(f"{CLEAN}, {light}" for light in lights), *conditions),
        f"Share of the images within {TIERS[0][0]:g} m and {TIERS[0][1]:g} degrees / share whose nearest reference is named, in "
        "per cent; for clean images, the median position error before it. A * marks a model that gives no heading, or is given it: "
        "it is judged by the place alone.",
    )
    for model in SHORT:
        mine = [row for row in usable if row.model == model]
        if mine:
            clean = [_short([row for row in mine if (row.light, row.condition) == (light, CLEAN)], True) for light in lights]
            others = [_short([row for row in mine if row.condition == condition]) for condition in conditions]
            drives = {verdict.drive for row in mine for verdict in row.verdicts}
            images = {verdict.name for row in mine for verdict in row.verdicts}
            name = model if all(row.gives_heading for row in mine) else f"{model} *"
            table.add(name, f"{len(drives)}, {len(images)}", *clean, *others)
    everything = report.table("All figures", COLUMNS)
    for row in rows:
        everything.add(*row.cells())
    return report


def _short(rows: Sequence[Row], with_error: bool = False) -> str:
    """Both rates over all lights, in per cent."""
    verdicts = [verdict for row in rows for verdict in row.verdicts]
    if not verdicts:
        return BLANK
    hits = sum(row.rate(TIERS[0]).hits for row in rows)
    rates = f"{100 * hits / len(verdicts):.0f} / {100 * sum(v.nearest for v in verdicts) / len(verdicts):.0f}"
    median = Spread([1000.0 * v.position_m for v in verdicts], 1, (0.5,))
    return f"{median.text()} mm, {rates}" if with_error else rates


def selected(models: Sequence[str], switches: Sequence[str]) -> list[str]:
    """Names of the rows that patterns mean, in the order of the table; every model itself comes with its switches.

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
        asked = [word for word in switches if word not in ("*", "none")]
        faults = _unknown("--switches", "switch of these models", asked, of_these)
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
    return [
        f"{option} {pattern}: no such {what}; {did_you_mean(pattern, known) or 'known: ' + (', '.join(known) or 'none')}"
        for pattern in patterns
        if not any(fnmatchcase(name, pattern) for name in known)
    ]


def settings_of(model: str) -> ObservationSettings:
    """Settings of a row's model."""
    return config_from_mapping({}, model, [f"observation.{text}" for text in MODELS[model]]).observation


def measured(
    name: str,
    dataset: Dataset,
    frames: dict[str, list[Frame]],
    recipes: Sequence[Recipe],
    seed: int,
    progress: Progress = no_progress,
) -> list[Row]:
    """The rows of one model, a key of `MODELS`; whatever fails becomes a row with its error."""
    try:
        bench = Bench(dataset, settings_of(name), seed, progress, heading_given=name in _HEADING_GIVEN)
    except Exception as error:
        return [Row(name, "all", "all", error=_in_a_line(error))]
    rows = []
    done, total = 0, len(recipes) * sum(map(len, frames.values()))
    for light, images in frames.items():
        for number, recipe in enumerate(recipes):
            row = Row(name, light, recipe.text)
            try:
                for index, frame in enumerate(images):
                    bench.add(row, frame, recipe, timed=number == 0 and index < _TIMED_IMAGES)
                    progress(done + index + 1, total, f"images, {name}")
            except Exception as error:
                row = Row(name, light, recipe.text, error=_in_a_line(error))
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
    progress : callable (done, total, what)
        Of building the map.
    heading_given : bool
        The model is asked about the true heading only.
    """

    def __init__(
        self, dataset: Dataset, settings: ObservationSettings, seed: int, progress: Progress, heading_given: bool = False
    ) -> None:
        self._map = cached_map(dataset, settings, seed, progress)
        self._model = self._map.observation_model(settings)
        self._viewer = Viewer(self._map, seed)
        self._heading_given = heading_given

    def add(self, row: Row, frame: Frame, recipe: Recipe, timed: bool = False) -> None:
        """Look at one image; with template matching, too, where time is taken."""
        panorama = self._viewer.panorama(frame, recipe)
        headings = frame.truth[2:] if self._heading_given else None
        votes = self._model.observe(panorama, headings)
        if timed:
            peer = template_matching(panorama.pixels, self._map.references.pixels)
            spent = interleaved({"mine": lambda: self._model.observe(panorama, headings).best_pose, "peer": peer}, 1, warm_up=0)
            row.seconds.append((float(spent["mine"].clock[0]), float(spent["peer"].clock[0])))
        row.gives_heading = self._model.gives_heading and not self._heading_given
        row.verdicts.append(Verdict.of(frame, votes, self._map.references.positions))


def _in_a_line(error: Exception) -> str:
    text = "; ".join(error.faults) if isinstance(error, PanolocError) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())
