"""The run configuration: every parameter with its unit, default, range and effect.

The descriptions of these fields are the parameter reference (``CONFIGURATION.md``, see `panoloc_mcl.config.reference`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, JsonValue

from panoloc_mcl.config.localizer import LocalizerSettings
from panoloc_mcl.config.peers import (
    EigenspaceSettings,
    FourierSignatureSettings,
    LeastSquaresSettings,
    OrientationCorrelationSettings,
    SpinningSettings,
    ZeroPhaseSettings,
)
from panoloc_mcl.config.validation import StrictModel

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]


# Marks settings that matter when an image is looked at, but not when a map is built: changing them needs no new map.
OBSERVING: dict[str, JsonValue] = {"matters": "when an image is looked at"}


class VirtualPlacesSettings(StrictModel):
    """Places between the references, where no camera stood: their views are synthesised from the references around them."""

    enabled: bool = Field(
        True, description="Whether to synthesise them. Needs the camera's height and neighbouring references."
    )
    spacing_m: Positive | None = Field(
        None,
        le=10.0,
        description="Distance between virtual places, m; null = a quarter of the references' spacing, at most 0.25.",
    )
    sources: Annotated[int, Field(ge=1, le=8)] = Field(2, description="References that a view is synthesised from.")
    wall_distances: Annotated[int, Field(ge=4, le=200)] = Field(
        16, description="Wall distances tried in every direction, from 0.3 to 18 m."
    )
    neighbours: Annotated[int, Field(ge=1, le=32)] = Field(
        4, description="References around each one that its wall distances are judged by."
    )
    threads: Annotated[int, Field(ge=1, le=1024)] | None = Field(
        None,
        json_schema_extra=OBSERVING,
        description="Threads that work out the depths; null = one a core. The result does not depend on it.",
    )


class RefinementSettings(StrictModel):
    """The pose read off one image by comparing it with views synthesised around the best place."""

    enabled: bool = Field(True, description="Whether to refine. Needs virtual places.")
    iterations: Annotated[int, Field(ge=1, le=50)] = Field(
        12, description="Gauss-Newton steps at full resolution at most; a few coarse ones come before."
    )
    sources: Annotated[int, Field(ge=1, le=8)] = Field(
        4, description="References that the last views are synthesised from; the first steps use two."
    )
    tilt: bool = Field(True, description="Whether the camera's pitch and roll are estimated, too.")
    candidates: Annotated[int, Field(ge=1, le=100)] = Field(
        5, description="Best cells, some way apart from each other, that are refined at most before one is chosen."
    )
    sufficient_agreement: Annotated[float, Field(ge=-1.0, le=1.0)] = Field(
        0.5,
        description="A refined pose whose view agrees with the image by this much (cosine) is taken without refining further cells.",
    )


class VotesSettings(StrictModel):
    """The default observation model: votes in an eigenspace of locally normalised gradients."""

    gradient: Literal["doubled_angle", "signed", "linear"] = Field(
        "doubled_angle",
        description="What is compared. doubled_angle: local orientation; edges whose contrast flips between day and night still "
        "agree; signed: local orientation, contrast counts; linear: gradients as they are, as in the paper, which only a gain of "
        "the whole image leaves alike.",
    )
    contrast_floor: Positive = Field(
        4.0,
        le=255.0,
        description="Gradients well below this many grey levels per pixel count little (the c of |z| / (|z| + c)); with linear "
        "gradients, images whose mean gradient is.",
    )
    smoothing_px: NonNegative = Field(
        1.0, le=20.0, description="Standard deviation of the Gaussian before the gradient, pixels."
    )
    median: bool = Field(True, description="3x3 median before everything else: keeps single bad pixels out of the gradients.")
    mask_dark: Annotated[int, Field(ge=-1, le=254)] = Field(
        2, description="Pixels at or below this grey level carry no information; -1 = keep all."
    )
    mask_bright: Annotated[int, Field(ge=1, le=256)] = Field(
        253, description="Pixels at or above this grey level carry no information; 256 = keep all."
    )
    components: Annotated[int, Field(ge=1, le=2000)] | None = Field(
        None,
        description="Eigenimages kept; null = an eighth of the places, 60 at least and 200 at most, as far as they span them.",
    )
    bandwidth: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.35,
        description="Share of the row frequencies that votes are formed from, the lowest first. The finest tell no more about "
        "places and cost as much.",
    )
    vote_width: Positive = Field(
        0.7,
        le=3.2,
        json_schema_extra=OBSERVING,
        description="Width sigma of the voting function exp(-d^2 / 2 sigma^2) over the angle d, radians (paper: 0.3).",
    )
    tolerance: Positive | None = Field(
        None,
        le=100.0,
        json_schema_extra=OBSERVING,
        description="How far the votes at the true pose may fall short of the best ones (standard deviation, as a share of the best). "
        "Low: certain at once; high: cautious. null = as learnt from held-out references, at least 0.08.",
    )
    calibration_references: Annotated[int, Field(ge=0, le=100_000)] = Field(
        16,
        description="References that are held out one by one to learn how sure a pose is; below 2: no confidence is given, and no "
        "image fits nowhere.",
    )
    fits_nowhere_below: Share = Field(
        0.45,
        json_schema_extra=OBSERVING,
        description="An image whose best pose is less probable than this fits nowhere in the map: it is skipped, and said to be so.",
    )
    full_match: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.2,
        json_schema_extra=OBSERVING,
        description="Cosine of a match that is trusted in full; images whose best match is weaker sharpen the belief less.",
    )
    min_visible: Share = Field(
        0.05,
        json_schema_extra=OBSERVING,
        description="An image with a smaller share of usable pixels says nothing and is skipped.",
    )
    virtual_places: VirtualPlacesSettings = Field(
        default_factory=VirtualPlacesSettings, description="Places between the references."
    )
    refinement: RefinementSettings = Field(
        default_factory=RefinementSettings, json_schema_extra=OBSERVING, description="The pose between the places."
    )


class PaperSettings(StrictModel):
    """The voting of Steinbauer & Bischof (2004), sections 2 and 3.2, as printed."""

    components: Annotated[int, Field(ge=1, le=100_000)] = Field(15, description="Eigenimages p of the grey-level eigenspace.")
    filters: Literal["gradients", "steerable"] = Field(
        "gradients",
        description="Three filters in directions 60 degrees apart. gradients: 3x3, as in the paper; steerable: derivatives of a "
        "Gaussian, which the paper recommends.",
    )
    filter_width_px: Positive = Field(
        1.0, le=100.0, description="Standard deviation of the Gaussian of the steerable filters, pixels."
    )
    hypotheses: Annotated[int, Field(ge=1, le=10_000)] = Field(50, description="Random subsets of pixels, each one hypothesis.")
    pixels: Annotated[int, Field(ge=2, le=1_000_000)] = Field(1000, description="Pixels a hypothesis starts from.")
    trim_keep: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        0.8, description="Share of the pixels with the smallest residuals kept in each trimming step (Leonardis & Bischof)."
    )
    trim_to: Annotated[int, Field(ge=2, le=1_000_000)] = Field(
        800,
        description="Trimming ends at this many pixels. The default is a single step; going on down to 300 (20 p), as Leonardis & "
        "Bischof do, ends among flat pixels, which fit anything.",
    )
    vote_width: Positive = Field(0.3, le=3.2, description="Width sigma of the voting function over the angle, radians.")
    heading_step_deg: Annotated[float, Field(gt=0.0, le=90.0)] = Field(
        4.0, description="Step of the headings that are voted on when all are asked for (Monte Carlo mode), degrees."
    )
    tolerance: Positive = Field(
        0.3,
        le=100.0,
        description="As in `votes`: what the true pose may fall short of the best votes, as a share (Monte Carlo mode).",
    )


class ObservationSettings(StrictModel):
    """What an image says about the pose."""

    model: Literal[
        "votes",
        "paper",
        "fourier_signature",
        "eigenspace",
        "least_squares",
        "spinning",
        "zero_phase",
        "orientation_correlation",
    ] = Field(
        "votes",
        description="votes: all headings at once, stands changing light; paper: the paper's voting as printed; the others: methods "
        "that these are compared with.",
    )
    votes: VotesSettings = Field(default_factory=VotesSettings, description="Settings of the model `votes`.")
    paper: PaperSettings = Field(default_factory=PaperSettings, description="Settings of the model `paper`.")
    fourier_signature: FourierSignatureSettings = Field(
        default_factory=FourierSignatureSettings, description="Settings of the model `fourier_signature`."
    )
    eigenspace: EigenspaceSettings = Field(
        default_factory=EigenspaceSettings, description="Settings of the model `eigenspace`."
    )
    least_squares: LeastSquaresSettings = Field(
        default_factory=LeastSquaresSettings, description="Settings of the model `least_squares`."
    )
    spinning: SpinningSettings = Field(default_factory=SpinningSettings, description="Settings of the model `spinning`.")
    zero_phase: ZeroPhaseSettings = Field(default_factory=ZeroPhaseSettings, description="Settings of the model `zero_phase`.")
    orientation_correlation: OrientationCorrelationSettings = Field(
        default_factory=OrientationCorrelationSettings, description="Settings of the model `orientation_correlation`."
    )


class KidnapSettings(StrictModel):
    """Carrying the robot away: sequences of one light are cut and spliced, odometry silent."""

    every_frames: Annotated[int, Field(ge=0, le=1_000_000)] = Field(0, description="Frames between two kidnaps; 0 = never.")


class RunConfig(StrictModel):
    """One run: a data set, a map, a localizer, what to write."""

    name: str = Field(
        "run", min_length=1, max_length=80, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", description="Folder name under `out`."
    )
    dataset: str = Field("hall", min_length=1, description="Path of a data set, or the name of an embedded one (`hall`).")
    sequences: Literal["all"] | list[str] = Field("all", description="`all`, or a list of names or globs such as `noon_*`.")
    map: Path | None = Field(
        None, description="A map file made by `panoloc build-map`; null = build from the references, cached."
    )
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(0, description="Seed of everything random.")
    runs: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        1, description="How often each sequence is run, with seeds seed, seed + 1, …"
    )
    out: Path = Field(Path("results"), description="Folder the results folder is made in.")
    observation: ObservationSettings = Field(default_factory=ObservationSettings, description="The observation model.")
    localizer: LocalizerSettings = Field(default_factory=LocalizerSettings, description="The localizer.")
    kidnap: KidnapSettings = Field(default_factory=KidnapSettings, description="Kidnapping.")
