"""Settings of the localizer: motion, filters, status."""

from __future__ import annotations

import os
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from panoloc_mcl.robot.settings.validation import StrictModel

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Coordinate = Annotated[float, Field(ge=-1e8, le=1e8)]

# Of a particle, at the peak of a cycle: poses before and after resampling, weights and indices.
BYTES_PER_PARTICLE = 56


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
        raise ValueError(
            f"must be at most {most}, as many as fit into this machine's {memory / 2**30:.1f} GiB of memory; lower it"
        )
    return count


class InitialPose(StrictModel):
    """A start pose with standard deviations."""

    x: Coordinate = Field(description="Position in the map frame, m.")
    y: Coordinate = Field(description="Position in the map frame, m.")
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
    slip_noise_from_translation: NonNegative = Field(
        0.05,
        le=10.0,
        description="Position noise across the way per metre driven, m/m, by wheels that slip; differential only. The textbook's model "
        "has 0.",
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
        20.0,
        le=1e3,
        description="Odometry that jumps faster than this is left out and told, m/s; null = unchecked. If what follows agrees with "
        "the jump, odometry has begun from a new origin and goes on from there.",
    )
    max_turn_rate_deg_s: Positive | None = Field(1440.0, le=1e5, description="The same for turns, degrees/s; null = unchecked.")
    clock_jump_s: Positive = Field(
        10.0,
        le=1e6,
        description="A time stamp this far from those before is left out, unless the next one agrees with it: then the clock has "
        "jumped, s.",
    )
    buffer_s: Positive = Field(30.0, le=3600.0, description="How much odometry is kept for late images, s.")


class RecoverySettings(StrictModel):
    """Particles drawn from the vote field: global localization, and the way back after being carried away."""

    carried_off: Share = Field(
        0.01,
        description="Chance that the robot was carried elsewhere since the last image; none where max_share is 0. Where the map is not "
        "calibrated, the share of particles drawn takes its place if it is more.",
    )
    min_share: Share = Field(0.02, description="Share of the particles drawn from the votes of every informative image.")
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
        2000, description="Particles (at the start, if their count adapts). More: surer start, slower; 56 bytes each."
    )
    resampling: ResamplingSettings = Field(default_factory=ResamplingSettings, description="Which particles go on.")
    adaptive: AdaptiveSettings = Field(default_factory=AdaptiveSettings, description="A count that follows the belief.")
    threads: Annotated[int, Field(ge=1, le=1024)] = Field(
        1, description="Threads that move and weigh particles. Pays from some 20 000 on; the result does not depend on it."
    )
    floor: Annotated[float, Field(ge=0.0, lt=1.0)] = Field(
        0.005,
        description="Least likelihood by the votes, relative to that of the best cell: votes of images in a row err alike, so none may "
        "say more.",
    )
    measured_share: Share = Field(
        0.3, description="Share of the particles drawn around the pose that an image gives by itself (refinement)."
    )
    measured_doubt: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.01,
        description="Chance that an image is wrong about the pose. Where the map is calibrated: the doubt of the image itself, if that "
        "is more.",
    )
    correlated: bool = Field(
        True,
        description="Images in a row err alike: each counts for what the way driven since the one before makes new. false = every "
        "image counts in full, for tests and comparisons.",
    )
    annealing_m: NonNegative = Field(
        0.1,
        le=100.0,
        description="Distance over which votes fall by their tolerance. Particles farther apart than this see a blurred likelihood; "
        "0 = never blurred, m.",
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
    converged_confidence: Share = Field(
        0.75,
        description="To become converged, an image must have been seen whose pose is right with at least this probability, where the "
        "map can tell: several doubtful images that agree may all be wrong alike, as outside the mapped part. Of images that "
        "show more noise than world, two must agree.",
    )
    ambiguous_mass: Share = Field(0.2, description="Ambiguous: two or more clusters hold more than this share each.")
    lost_match: Share = Field(
        0.05,
        description="Lost: after having been converged, what the belief explains of the best votes (running average) is below this, …",
    )
    lost_chance: Share = Field(
        0.05,
        description="… or an image says with at least this probability that the robot is elsewhere, or refutes the pose that the last "
        "answer was sure of.",
    )
    counted_odds: Annotated[float, Field(ge=1.0, le=1e9)] = Field(
        100.0,
        description="An image counts if it is sure of itself and says what is believed, or if it, with doubtful ones before it, is so "
        "many times better explained by this pose than by any other: of robots that were carried off, one in so many is taken to be "
        "here by luck.",
    )
    stale_images: Annotated[int, Field(ge=1)] = Field(
        4,
        description="Stale: after having been converged, so many images in a row did not count, whatever the reason, or odometry has "
        "led farther from the last one that was taken in than a belief that is sure may be wide.",
    )


class GateSettings(StrictModel):
    """Images are left out until the robot has moved; both 0 = every image counts. `Localizer.force_update` lets the next one count."""

    distance_m: NonNegative = Field(0.0, le=1e3, description="Distance driven that opens the gate, m.")
    angle_deg: NonNegative = Field(0.0, le=360.0, description="Turn that opens the gate, degrees.")


class LocalizerSettings(StrictModel):
    """The localizer: which filter, from what start, and its parts."""

    mode: Literal["monte_carlo", "kalman_orientation", "odometry_only"] = Field(
        "monte_carlo",
        description="monte_carlo: particle filter; kalman_orientation: the paper's tracker, the baseline; odometry_only: dead "
        "reckoning, images change nothing.",
    )
    initial: Literal["uniform", "known_heading", "known_pose"] | InitialPose = Field(
        "uniform",
        description="uniform: nothing known; known_heading, known_pose: from the ground truth of the sequence; "
        "or a mapping x, y, heading_deg, sd_position_m, sd_heading_deg.",
    )
    initial_heading_error_deg: float = Field(
        0.0,
        ge=-180.0,
        le=180.0,
        description="Added to the heading of known_heading and known_pose, which is believed to be right: what a wrong start costs, "
        "degrees.",
    )
    monte_carlo: MonteCarloSettings = Field(default_factory=MonteCarloSettings, description="Settings of `monte_carlo`.")
    kalman_orientation: KalmanSettings = Field(default_factory=KalmanSettings, description="Settings of `kalman_orientation`.")
    motion: MotionSettings = Field(default_factory=MotionSettings, description="Odometry and its noise.")
    status: StatusSettings = Field(default_factory=StatusSettings, description="Thresholds of the status.")
    gate: GateSettings = Field(default_factory=GateSettings, description="Motion gate.")
    tracking: bool = Field(
        True,
        description="While the pose is known well, an image is compared where the robot is expected, after a glance at the whole map; "
        "all over the map where that does not fit, and for every tenth image. false = always all over the map.",
    )
