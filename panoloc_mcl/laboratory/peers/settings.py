"""Settings of the paper's voting and of the cited peers: observation models that the default one is compared with."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from panoloc_mcl.robot.settings.validation import StrictModel

Positive = Annotated[float, Field(gt=0.0)]
Components = Annotated[int, Field(ge=1, le=100_000)]

_TOLERANCE = "As in `votes`: what the true pose may fall short of the best votes, as a share (Monte Carlo mode)."
_VOTE_WIDTH = (
    "Distance in the eigenspace at which a place has half of the votes, as a share of the root mean square length of the "
    "references' coefficients."
)
_UNIT_ENERGY = "Scale every image to the same energy first, as Murase & Nayar do; otherwise grey levels count as they are."


class FourierSignatureSettings(StrictModel):
    """Fourier signature (Ishiguro & Tsuji 1996; Menegatti et al. 2004): magnitudes of the low row frequencies."""

    frequencies: Annotated[int, Field(ge=2, le=10_000)] = Field(
        15, description="Row frequencies of the signature, from the mean (frequency 0) on; at most half the columns."
    )
    heading: Literal["phases", "none"] = Field(
        "phases", description="phases: the heading from the signature's phases; none: magnitudes only, which give no heading."
    )
    tolerance: Positive = Field(0.2, le=100.0, description=_TOLERANCE)


class EigenspaceSettings(StrictModel):
    """Plain projection on an eigenspace of grey levels, nearest neighbour (Murase & Nayar 1995)."""

    components: Components = Field(15, description="Eigenimages p of the grey-level eigenspace, mean removed.")
    unit_energy: bool = Field(True, description=_UNIT_ENERGY)
    vote_width: Positive = Field(0.5, le=100.0, description=_VOTE_WIDTH)
    tolerance: Positive = Field(0.15, le=100.0, description=_TOLERANCE)


class LeastSquaresSettings(StrictModel):
    """Least squares over all pixels in the filtered eigenspace (Bischof, Wildenauer & Leonardis 2001), without hypotheses."""

    components: Components = Field(15, description="Eigenimages p of the grey-level eigenspace, mean removed.")
    mean_column: bool = Field(
        False,
        description="Solve for the gain of the mean image, too, instead of subtracting it: angles then do not depend on the gain.",
    )
    vote_width: Positive = Field(0.3, le=3.2, description="Width sigma of the voting function over the angle, radians.")
    tolerance: Positive = Field(0.5, le=100.0, description=_TOLERANCE)


class SpinningSettings(StrictModel):
    """Eigenspace of spinning images (Jogan & Leonardis 2000, 2003): all rotated copies of all references."""

    components: Components = Field(
        100,
        description="Complex eigenimages p over all frequencies; one of a frequency above 0 counts with its conjugate as one.",
    )
    unit_energy: bool = Field(True, description=_UNIT_ENERGY)
    vote_width: Positive = Field(0.5, le=100.0, description=_VOTE_WIDTH)
    tolerance: Positive = Field(0.15, le=100.0, description=_TOLERANCE)


class ZeroPhaseSettings(StrictModel):
    """Zero phase representation (Pajdla & Hlavac 1999): images turned until their first harmonic has phase 0."""

    components: Components = Field(15, description="Eigenimages p of the eigenspace of zero phase images, mean removed.")
    unit_energy: bool = Field(True, description=_UNIT_ENERGY)
    vote_width: Positive = Field(0.5, le=100.0, description=_VOTE_WIDTH)
    heading_width_deg: Positive = Field(
        10.0, le=180.0, description="Standard deviation of the heading that a place's shift gives, degrees."
    )
    tolerance: Positive = Field(0.5, le=100.0, description=_TOLERANCE)


class OrientationCorrelationSettings(StrictModel):
    """Orientation correlation (Fitch et al. 2002): complex signs of the gradients, correlated over all headings."""

    tolerance: Positive = Field(0.25, le=100.0, description=_TOLERANCE)


class NearestReferenceSettings(StrictModel):
    """Nearest reference: circular correlation of normalised gradients with every reference, and nothing else."""

    contrast_floor: Positive = Field(
        4.0, le=255.0, description="Gradients well below this many grey levels per pixel count little (the c of z / (|z| + c))."
    )
    tolerance: Positive = Field(0.05, le=100.0, description=_TOLERANCE)


class StructureSettings(StrictModel):
    """Features, triangulated points and P3P (COLMAP, hloc): what kinds of features share."""

    width: Annotated[int, Field(ge=360, le=8192)] = Field(
        720, description="Columns that the panorama is enlarged to before features are looked for."
    )
    features: Annotated[int, Field(ge=16, le=65536)] = Field(4096, description="Features of an image, the strongest first.")
    neighbours: Annotated[int, Field(ge=1, le=1000)] = Field(
        8, description="Nearest references that each one is matched with to triangulate points."
    )
    candidates: Annotated[int, Field(ge=1, le=1000)] = Field(
        10, description="References, those most alike, that an image's points are taken from."
    )
    max_error_px: Positive = Field(
        6.0, le=1000.0, description="Reprojection error of an inlier, pixels of the enlarged panorama."
    )
    min_inliers: Annotated[int, Field(ge=4, le=10_000)] = Field(
        12, description="With fewer points that agree there is no answer."
    )
    tolerance: Positive = Field(0.2, le=100.0, description=_TOLERANCE)


class ColmapSiftSettings(StructureSettings):
    """Structure from the references and P3P with COLMAP's SIFT (Schoenberger & Frahm 2016); extra ``peers``."""

    ratio: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.8, description="A match is at most so far as the second nearest (Lowe)."
    )


class XFeatSettings(StructureSettings):
    """The same with learned features: XFeat and LighterGlue (Potje et al. 2024); extra ``peers``."""

    features: Annotated[int, Field(ge=16, le=65536)] = Field(1500, description="Features of an image, the strongest first.")
    candidates: Annotated[int, Field(ge=1, le=1000)] = Field(
        4, description="References, those most alike, that an image's points are taken from; each costs the matcher's time."
    )
    least_cosine: Annotated[float, Field(ge=-1.0, lt=1.0)] = Field(
        0.82, description="Descriptors at least so alike count where references are ranked."
    )


class TemplateMatchingSettings(StrictModel):
    """Template matching (OpenCV): normalised correlation of the whole image with every reference at every heading."""

    tolerance: Positive = Field(0.2, le=100.0, description=_TOLERANCE)


class BagOfWordsSettings(StrictModel):
    """Bag of visual words (Sivic & Zisserman 2003): SIFT, a k-means vocabulary, tf-idf; heading by where the words stand."""

    width: Annotated[int, Field(ge=360, le=8192)] = Field(720, description="As in `colmap_sift`.")
    features: Annotated[int, Field(ge=16, le=65536)] = Field(2048, description="Features of an image, the strongest first.")
    words: Annotated[int, Field(ge=2, le=100_000)] = Field(
        1000, description="Words of the vocabulary, learnt from the references."
    )
    heading_width_deg: Positive = Field(
        2.0, le=180.0, description="Standard deviation of the turn that a pair of equal words tells, degrees."
    )
    tolerance: Positive = Field(0.2, le=100.0, description=_TOLERANCE)


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
