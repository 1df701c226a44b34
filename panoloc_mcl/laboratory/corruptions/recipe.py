"""Corruptions by name: what ``bars:0.7+random_pixels:0.25`` and ``body:strong+jpeg:mild`` mean."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from panoloc_mcl.laboratory.corruptions import images
from panoloc_mcl.laboratory.corruptions.imperfections import IMPERFECTIONS, LEVELS, Use
from panoloc_mcl.laboratory.corruptions.sequences import drop_frames
from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.errors import ConfigError, did_you_mean
from panoloc_mcl.robot.settings.validation import StrictModel, parse_yaml, validate

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Degrees = Annotated[float, Field(gt=0.0, le=180.0)]


class _OfShare(StrictModel):
    share: Share


class _Bars(_OfShare):
    count: Annotated[int, Field(ge=1, le=1000)] = 4


class _Blobs(_OfShare):
    size_deg: Degrees = 10.0


class _Gain(StrictModel):
    factor: Annotated[float, Field(ge=0.0, le=256.0)]


class _SpatialLight(StrictModel):
    log_sd: Annotated[float, Field(ge=0.0, le=5.0)] = 0.6
    gain: Annotated[float, Field(ge=0.0, le=256.0)] = 0.12
    scale_deg: Degrees = 30.0
    full_well: Annotated[float, Field(ge=0.0, le=1e9)] = 10_000.0
    read_noise: Annotated[float, Field(ge=0.0, le=1e6)] = 8.0


class _Blur(StrictModel):
    sigma: Annotated[float, Field(ge=0.0, le=1000.0)]


class _Tilt(StrictModel):
    degrees: Annotated[float, Field(ge=0.0, le=45.0)]


class _Lean(StrictModel):
    pitch_deg: Annotated[float, Field(ge=-45.0, le=45.0)]
    roll_deg: Annotated[float, Field(ge=-45.0, le=45.0)] = 0.0


class _Noise(StrictModel):
    sd: Annotated[float, Field(ge=0.0, le=255.0)]


@dataclass(frozen=True)
class Corruption:
    """One kind of corruption.

    Parameters
    ----------
    apply : callable
        A function of `panoloc_mcl.laboratory.corruptions.images`, or `drop_frames`.
    parameters : type
        Its severities with their ranges; the first one may be written without its name.
    of_sequences : bool
        It takes frames away, and leaves images as they are.
    needs_elevation : bool
        It is told the elevations that the panorama covers.
    """

    apply: Callable[..., NDArray[Any]]
    parameters: type[StrictModel]
    of_sequences: bool = False
    needs_elevation: bool = False


#: All of them, by the names that recipes use.
CORRUPTIONS: dict[str, Corruption] = {
    "random_pixels": Corruption(images.random_pixels, _OfShare),
    "bars": Corruption(images.bars, _Bars),
    "blobs": Corruption(images.blobs, _Blobs),
    "gain": Corruption(images.gain, _Gain),
    "spatial_light": Corruption(images.spatial_light, _SpatialLight),
    "blur": Corruption(images.blur, _Blur),
    "tilt": Corruption(images.tilt, _Tilt, needs_elevation=True),
    "lean": Corruption(images.lean, _Lean, needs_elevation=True),
    "noise": Corruption(images.noise, _Noise),
    "drop_frames": Corruption(drop_frames, _OfShare, of_sequences=True),
}

#: The recipe that changes nothing.
CLEAN = "clean"
#: All imperfections at once.
EVERYTHING = "everything"
#: What the data set says of them: mask, mount, clock; a camera that is calibrated.
TOLD = "told"
_PLACES = ("both", "references", "drives")


@dataclass(frozen=True)
class Recipe:
    """Corruptions one after the other.

    Parameters
    ----------
    text : str
        As it was written.
    steps : tuple of (Corruption, dict)
        Each with its severities.
    uses : tuple of Use
        Imperfections of the data set itself, in the order of their catalogue.
    told : bool
        Whether the data set says of them what can be known.
    """

    text: str
    steps: tuple[tuple[Corruption, dict[str, Any]], ...]
    uses: tuple[Use, ...] = ()
    told: bool = False

    @property
    def changes_data(self) -> bool:
        """Whether there is anything that a data set has to be written for."""
        return bool(self.uses)

    @property
    def changes_images(self) -> bool:
        """Whether any step is about images."""
        return any(not corruption.of_sequences for corruption, _ in self.steps)

    def image(
        self, image: NDArray[np.uint8], rng: np.random.Generator, elevation_deg: tuple[float, float]
    ) -> NDArray[np.uint8]:
        """The corrupted image.

        Parameters
        ----------
        image : uint8 (rows, columns) or (rows, columns, channels)
            A panorama, columns clockwise over the full circle; it is not changed.
        rng : Generator
        elevation_deg : (float, float)
            Elevation of its lower and of its upper edge, degrees.

        Returns
        -------
        uint8, same shape
        """
        corrupted = image.copy()
        for corruption, severities in self.steps:
            if not corruption.of_sequences:
                told = {"elevation_deg": elevation_deg} if corruption.needs_elevation else {}
                corrupted = corruption.apply(corrupted, rng, **severities, **told)
        return corrupted

    def panorama(self, panorama: Panorama, rng: np.random.Generator, elevation_deg: tuple[float, float]) -> Panorama:
        """The corrupted panorama; what the camera does not see stays so."""
        if not self.changes_images:
            return panorama
        grey = np.clip(np.rint(panorama.pixels), 0.0, 255.0).astype(np.uint8)
        pixels = self.image(grey, rng, elevation_deg).astype(np.float32)
        if panorama.valid is not None:
            pixels[~panorama.valid] = 0.0
        return Panorama(pixels, panorama.valid)

    def frames(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Ascending indices of the frames that are left of ``count``, int64 (n,)."""
        left = np.arange(count, dtype=np.int64)
        for corruption, severities in self.steps:
            if corruption.of_sequences:
                left = left[corruption.apply(len(left), rng, **severities)]
        return left


def parse_recipe(text: str) -> Recipe:
    """Read a recipe.

    Parameters
    ----------
    text : str
        Steps joined by ``+``, each a name of ``CORRUPTIONS`` and, after a colon, its severities joined by commas:
        ``bars:0.7``, ``bars:0.7,count=2+noise:3``, ``spatial_light``. Or names of ``IMPERFECTIONS``, each with its level, and values
        that it has instead: ``body:strong``, ``body:strong,strut_deg=30+jpeg:mild``; with ``where=references`` or ``where=drives``
        they disturb only these images. Or ``everything:mild``, ``everything:strong``. With ``+told`` the data set says what can be
        known: mask, mount, the clocks' difference, how well references were surveyed, and a camera that is calibrated. Or ``clean``.

    Raises
    ------
    ConfigError
        Names that there are not, severities that are missing, out of range or not numbers; one line each.
    """
    if text.strip() == CLEAN:
        return Recipe(text, ())
    steps: list[tuple[Corruption, dict[str, Any]]] = []
    uses: list[Use] = []
    told = False
    faults: list[str] = []
    for part in text.split("+"):
        try:
            name = part.partition(":")[0].strip()
            if part.strip() == TOLD:
                told = True
            elif name in IMPERFECTIONS or name == EVERYTHING:
                uses += _uses(part.strip(), f"corruption '{text}'")
            else:
                steps.append(_step(part.strip(), f"corruption '{text}'"))
        except ConfigError as error:
            faults.extend(error.faults)
    names = [use.name for use in uses]
    faults += [
        f"corruption '{text}': '{name}' is given twice; drop one" for name in dict.fromkeys(names) if names.count(name) > 1
    ]
    if told and not uses:
        faults.append(f"corruption '{text}': has no imperfection that could be told of; name one")
    if faults:
        raise ConfigError(faults)
    order = list(IMPERFECTIONS)
    return Recipe(text, tuple(steps), tuple(sorted(uses, key=lambda use: order.index(use.name))), told)


def _step(text: str, source: str) -> tuple[Corruption, dict[str, Any]]:
    name, _, severities = text.partition(":")
    corruption = CORRUPTIONS.get(name)
    if corruption is None:
        known = [*CORRUPTIONS, *IMPERFECTIONS, EVERYTHING, TOLD, CLEAN]
        remedy = did_you_mean(name, known) or f"known: {', '.join(known)}"
        raise ConfigError(f"{source}: unknown corruption '{name}'; {remedy}")
    given = _severities(severities, text, source, next(iter(corruption.parameters.model_fields)))
    return corruption, validate(corruption.parameters, given, f"{source}: {name}").model_dump()


def _uses(text: str, source: str) -> list[Use]:
    """An imperfection, or all of them, at the level that is named."""
    name, _, severities = text.partition(":")
    given = _severities(severities, text, source, "level")
    level = given.pop("level", None)
    if level not in LEVELS:
        said = "is missing" if level is None else f"= {level!r}: is no level"
        raise ConfigError(f"{source}: {name}: level {said}; write {name}:{LEVELS[0]} or {name}:{LEVELS[1]}")
    if name == EVERYTHING:
        if given:
            raise ConfigError(f"{source}: {EVERYTHING} takes no '{next(iter(given))}'; name the imperfection and its level")
        wanted = [name for name, imperfection in IMPERFECTIONS.items() if imperfection.together]
        return [use for name in wanted for use in _uses(f"{name}:{level}", source)]
    imperfection = IMPERFECTIONS[name]
    where = imperfection.where
    if "where" in given and "where" not in imperfection.settings.model_fields and not imperfection.changes_data:
        where = given.pop("where")
        if where not in _PLACES:
            raise ConfigError(f"{source}: {name}: where = {where!r}; use one of {', '.join(_PLACES)}")
    return [Use(name, validate(imperfection.settings, {**imperfection.at(level), **given}, f"{source}: {name}"), where)]


def _severities(severities: str, text: str, source: str, first: str) -> dict[str, Any]:
    """What stands after the colon; its first value may do without a name."""
    given: dict[str, Any] = {}
    for position, entry in enumerate(severities.split(",") if severities else ()):
        key, separator, value = (word.strip() for word in entry.partition("="))
        if not separator:
            if position:
                raise ConfigError(f"{source}: '{entry}' in '{text}' has no name; write NAME={entry.strip()}")
            key, value = first, key
        if key in given:
            raise ConfigError(f"{source}: '{key}' is given twice in '{text}'; drop one")
        given[key] = parse_yaml(value, source, locate=False)
    return given
