"""The run configuration: every parameter with its unit, default, range and effect.

The descriptions of these fields are the parameter reference (``CONFIGURATION.md``, see `panoloc_mcl.config.reference`).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, JsonValue, field_validator, model_validator

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


# Of a particle, at the peak of a cycle: poses before and after resampling, weights and indices.
BYTES_PER_PARTICLE = 64


def physical_memory() -> int | None:
    """Bytes of the machine's memory; None where it does not tell."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None


def fitting_memory(count: int) -> int:
    """The count of particles, if the machine can hold them."""
    memory = physical_memory()
    if memory is not None and count * BYTES_PER_PARTICLE > memory:
        most = memory // BYTES_PER_PARTICLE
        raise ValueError(f"must be at most {most}, as many as fit into this machine's {memory / 2**30:.1f} GiB of memory; lower it")
    return count


class InitialPose(StrictModel):
    """A start pose with standard deviations."""

    x: float = Field(description="Position in the map frame, m.")
    y: float = Field(description="Position in the map frame, m.")
    heading_deg: float = Field(description="Heading, counter-clockwise from the map's x axis, degrees.")
    sd_position_m: NonNegative = Field(0.2, le=1e3, description="Standard deviation of x and of y, m.")
    sd_heading_deg: NonNegative = Field(5.0, le=180.0, description="Standard deviation of the heading, degrees.")


class MotionSettings(StrictModel):
    """How the robot moves, and how far odometry is trusted. Standing still adds no noise at all.

    The noise parameters are standard deviations, so each is the square root of the alpha of Thrun et al. and of nav2's AMCL that its
    description names.
    """

    model: Literal["differential", "omnidirectional", "stationary"] = Field(
        "differential",
        description="differential: turns, drives and turns again; omnidirectional: also drives sideways; stationary: no odometry is "
        "read, and between images the robot may have moved as far as the image_only rates allow.",
    )
    rotation_noise_from_rotation: NonNegative = Field(
        0.1, le=10.0, description="Heading noise per radian turned, rad/rad (alpha1 of Thrun et al., as a standard deviation)."
    )
    rotation_noise_from_translation: NonNegative = Field(
        0.05, le=10.0, description="Heading noise per metre driven, rad/m (alpha2)."
    )
    translation_noise_from_translation: NonNegative = Field(
        0.15, le=10.0, description="Position noise along the way per metre driven, m/m (alpha3)."
    )
    translation_noise_from_rotation: NonNegative = Field(
        0.02, le=10.0, description="Position noise per radian turned, m/rad (alpha4)."
    )
    strafe_noise_from_translation: NonNegative = Field(
        0.15, le=10.0, description="Position noise across the way per metre driven, m/m (alpha5); omnidirectional only."
    )
    image_only_speed_m_s: Positive = Field(
        0.5, le=50.0, description="Speed up to which the robot may drive where no odometry is known, m/s."
    )
    image_only_turn_rate_deg_s: Positive = Field(
        45.0, le=3600.0, description="Rate up to which the robot may turn where no odometry is known, degrees/s."
    )
    max_extrapolation_s: NonNegative = Field(
        0.5,
        le=60.0,
        description="How long odometry that is older than the image is carried on, at its mean speed over as long a time before, s.",
    )
    max_speed_m_s: Positive | None = Field(
        None,
        le=1e3,
        description="Odometry that jumps faster than this is left out and told, m/s; null = unchecked. If what follows agrees with "
        "the jump, odometry has begun from a new origin and goes on from there.",
    )
    max_turn_rate_deg_s: Positive | None = Field(
        None, le=1e5, description="The same for turns, degrees/s; null = unchecked."
    )
    clock_jump_s: Positive = Field(
        10.0,
        le=1e6,
        description="A time stamp this far from those before is left out, unless the next one agrees with it: then the clock has "
        "jumped, s.",
    )
    buffer_s: Positive = Field(30.0, le=3600.0, description="How much odometry is kept for late images, s.")


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
    sources: Annotated[int, Field(ge=1, le=8)] = Field(2, description="References that the views are synthesised from.")
    tilt: bool = Field(True, description="Whether the camera's pitch and roll are estimated, too.")


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
    tolerance: Positive = Field(
        0.15,
        le=100.0,
        json_schema_extra=OBSERVING,
        description="How far the votes at the true pose may fall short of the best ones (standard deviation, as a share of the best). "
        "Low: certain at once; high: cautious.",
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


class RecoverySettings(StrictModel):
    """Particles drawn from the vote field: global localization, and the way back after being carried away."""

    min_share: Share = Field(0.02, description="Share of the particles drawn from every informative image.")
    max_share: Share = Field(0.5, description="Largest share, at the start with nothing known and when images stop fitting.")
    slow: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.05, description="Decay of the slow average of how well images fit (alpha_slow of augmented MCL)."
    )
    fast: Annotated[float, Field(gt=0.0, le=1.0)] = Field(0.5, description="Decay of the fast average (alpha_fast).")

    @model_validator(mode="after")
    def _ordered(self) -> RecoverySettings:
        if self.min_share > self.max_share:
            raise ValueError(f"min_share {self.min_share} is above max_share {self.max_share}; lower it")
        if self.slow >= self.fast:
            raise ValueError(f"slow {self.slow} must be below fast {self.fast}; lower it")
        return self


class ResamplingSettings(StrictModel):
    """Which particles go on, and when they are drawn."""

    scheme: Literal["systematic", "stratified", "residual", "multinomial"] = Field(
        "systematic", description="How particles are drawn in proportion to their weights; systematic has the least noise."
    )
    below: Share = Field(0.5, description="Resample when N_eff falls below this share of the particles; 1 = always, 0 = never.")


class AdaptiveSettings(StrictModel):
    """How many particles: as many as the belief is wide (KLD sampling, Fox 2003)."""

    enabled: bool = Field(False, description="Whether the count adapts; false = always `particles`.")
    min_particles: Annotated[int, Field(ge=10)] = Field(500, description="Never fewer than this.")
    max_particles: Annotated[int, Field(ge=10)] = Field(10_000, description="Never more than this.")
    bin_m: Positive = Field(0.25, le=100.0, description="Side of the bins whose number tells how wide the belief is, m.")
    bin_deg: Annotated[float, Field(gt=0.0, le=180.0)] = Field(10.0, description="Their width in heading, degrees.")
    error: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        0.05, description="Error allowed between the particles and the belief (Kullback-Leibler divergence)."
    )
    quantile: Annotated[float, Field(gt=0.5, lt=1.0)] = Field(
        0.99, description="Probability that the error is kept (its upper quantile of the normal distribution is nav2's pf_z)."
    )

    @model_validator(mode="after")
    def _ordered(self) -> AdaptiveSettings:
        if self.min_particles > self.max_particles:
            raise ValueError(f"min_particles {self.min_particles} is above max_particles {self.max_particles}; lower it")
        return self

    @field_validator("max_particles")
    @classmethod
    def _fits(cls, count: int) -> int:
        return fitting_memory(count)


class MonteCarloSettings(StrictModel):
    """The particle filter over position and heading."""

    particles: Annotated[int, Field(ge=10)] = Field(
        2000, description="Particles (at the start, if their count adapts). More: surer start, slower; 64 bytes each."
    )
    resampling: ResamplingSettings = Field(default_factory=ResamplingSettings, description="Which particles go on.")
    adaptive: AdaptiveSettings = Field(default_factory=AdaptiveSettings, description="A count that follows the belief.")
    threads: Annotated[int, Field(ge=1, le=1024)] = Field(
        1, description="Threads that move and weigh particles. Pays from some 20 000 on; the result does not depend on it."
    )
    floor: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        0.005, description="Uniform part of the likelihood, so that no single image can kill the truth."
    )
    measured_share: Share = Field(
        0.3, description="Share of the particles drawn around the pose that an image gives by itself (refinement)."
    )
    measured_doubt: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.02, description="Likelihood of a particle far from that pose relative to one at it: the chance that it is wrong."
    )
    recovery: RecoverySettings = Field(default_factory=RecoverySettings, description="Proposals drawn from the vote field.")

    @field_validator("particles")
    @classmethod
    def _fits(cls, count: int) -> int:
        return fitting_memory(count)


class KalmanSettings(StrictModel):
    """The paper's orientation tracker (section 3), the baseline."""

    headings: Annotated[int, Field(ge=1, le=1000)] = Field(5, description="Headings M drawn from the prediction per image.")
    measurement_noise_deg: Positive = Field(
        4.0, le=180.0, description="Standard deviation of the heading measured by an image, degrees; constant, as in the paper."
    )
    min_sd_deg: Positive = Field(1.0, le=180.0, description="Least standard deviation the headings are drawn with, degrees.")


class StatusSettings(StrictModel):
    """When the localizer calls itself converged, ambiguous or lost."""

    converged_mass: Share = Field(0.8, description="Converged: the largest cluster holds more than this share of the weight, …")
    converged_spread_m: Positive = Field(0.5, le=1e3, description="… spreads less than this (standard deviation), m, …")
    converged_spread_deg: Positive = Field(10.0, le=180.0, description="… and less than this, degrees.")
    ambiguous_mass: Share = Field(0.2, description="Ambiguous: two or more clusters hold more than this share each.")
    lost_match: Share = Field(
        0.05,
        description="Lost: after having been converged, what the belief explains of the best votes (running average) is below this.",
    )


class GateSettings(StrictModel):
    """Images are left out until the robot has moved; both 0 = every image counts."""

    distance_m: NonNegative = Field(0.0, le=1e3, description="Distance driven that opens the gate, m.")
    angle_deg: NonNegative = Field(0.0, le=360.0, description="Turn that opens the gate, degrees.")


class LocalizerSettings(StrictModel):
    """The localizer: which filter, from what start, and its parts."""

    mode: Literal["monte_carlo", "kalman_orientation"] = Field(
        "monte_carlo", description="monte_carlo: particle filter; kalman_orientation: the paper's tracker, the baseline."
    )
    initial: Literal["uniform", "known_heading", "known_pose"] | InitialPose = Field(
        "uniform",
        description="uniform: nothing known; known_heading, known_pose: from the ground truth of the sequence; "
        "or a mapping x, y, heading_deg, sd_position_m, sd_heading_deg.",
    )
    monte_carlo: MonteCarloSettings = Field(default_factory=MonteCarloSettings, description="Settings of `monte_carlo`.")
    kalman_orientation: KalmanSettings = Field(default_factory=KalmanSettings, description="Settings of `kalman_orientation`.")
    motion: MotionSettings = Field(default_factory=MotionSettings, description="Odometry and its noise.")
    status: StatusSettings = Field(default_factory=StatusSettings, description="Thresholds of the status.")
    gate: GateSettings = Field(default_factory=GateSettings, description="Motion gate.")


class KidnapSettings(StrictModel):
    """Carrying the robot away: sequences of one light are cut and spliced, odometry silent."""

    every_frames: Annotated[int, Field(ge=0, le=1_000_000)] = Field(0, description="Frames between two kidnaps; 0 = never.")


class RunConfig(StrictModel):
    """One run: a data set, a map, a localizer, what to write."""

    name: str = Field(
        "run", min_length=1, max_length=80, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", description="Folder name under `out`."
    )
    dataset: str = Field("room", min_length=1, description="Path of a data set, or the name of an embedded one (`room`).")
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
