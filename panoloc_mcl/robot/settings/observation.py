"""Settings of the observation models, and the one table of all models."""

from __future__ import annotations

import importlib
import importlib.util
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, JsonValue, create_model

from panoloc_mcl.robot.settings.validation import StrictModel

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
    columns: Annotated[int, Field(ge=16, le=16384)] | None = Field(
        None,
        description="Columns of the panoramas that are compared; null = chosen from the references, where views of neighbours fit "
        "most clearly, at most 720. Larger images are reduced to it.",
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
    wrong_share: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        1.0 / 3.0,
        description="How often the best pose of an image is wrong, before anything is seen of it: of images of nowhere, hidden ones, "
        "and such as are found astray. Sets how sure the map's calibration is.",
    )
    fits_nowhere_below: Share = Field(
        0.2,
        json_schema_extra=OBSERVING,
        description="An image whose best pose is less probable than this fits nowhere in the map: it is skipped, and said to be so.",
    )
    full_match: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.2,
        json_schema_extra=OBSERVING,
        description="Cosine of a match that is trusted in full; images whose best match is weaker sharpen the belief less.",
    )
    thinning: bool = Field(
        True,
        description="Leave out references that tell little new: half of what they show is seen by one kept within 0.5 m. False: all "
        "are used.",
    )
    doubted_references: Literal["leave_out", "keep"] = Field(
        "leave_out",
        description="A reference whose image fits clearly better at another pose than at its own: leave_out: the map does without it "
        "and a note names it; keep: poses are not judged.",
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


class Entry(NamedTuple):
    """Where an observation model and its settings are, each as ``module:Class``."""

    model: str
    settings: str


_PEERS = "panoloc_mcl.laboratory.peers"

#: All observation models by name, the default one first. Those of the laboratory are imported when they are asked for.
MODELS: dict[str, Entry] = {
    "votes": Entry("panoloc_mcl.robot.observation.votes:VotesModel", f"{__name__}:VotesSettings"),
    "paper": Entry(f"{_PEERS}.paper:PaperModel", f"{_PEERS}.settings:PaperSettings"),
    "fourier_signature": Entry(
        f"{_PEERS}.fourier_signature:FourierSignatureModel", f"{_PEERS}.settings:FourierSignatureSettings"
    ),
    "eigenspace": Entry(f"{_PEERS}.eigenspace:EigenspaceModel", f"{_PEERS}.settings:EigenspaceSettings"),
    "least_squares": Entry(f"{_PEERS}.least_squares:LeastSquaresModel", f"{_PEERS}.settings:LeastSquaresSettings"),
    "spinning": Entry(f"{_PEERS}.spinning:SpinningModel", f"{_PEERS}.settings:SpinningSettings"),
    "zero_phase": Entry(f"{_PEERS}.zero_phase:ZeroPhaseModel", f"{_PEERS}.settings:ZeroPhaseSettings"),
    "orientation_correlation": Entry(
        f"{_PEERS}.correlation.orientation_correlation:OrientationCorrelationModel",
        f"{_PEERS}.settings:OrientationCorrelationSettings",
    ),
    "nearest_reference": Entry(
        f"{_PEERS}.correlation.nearest_reference:NearestReferenceModel", f"{_PEERS}.settings:NearestReferenceSettings"
    ),
    "template_matching": Entry(
        f"{_PEERS}.correlation.template_matching:TemplateMatchingModel", f"{_PEERS}.settings:TemplateMatchingSettings"
    ),
    "bag_of_words": Entry(f"{_PEERS}.local_features.bag_of_words:BagOfWordsModel", f"{_PEERS}.settings:BagOfWordsSettings"),
    "colmap_sift": Entry(f"{_PEERS}.local_features.structure:ColmapSiftModel", f"{_PEERS}.settings:ColmapSiftSettings"),
    "xfeat": Entry(f"{_PEERS}.local_features.structure:XFeatModel", f"{_PEERS}.settings:XFeatSettings"),
}


class ObservationSettings(StrictModel):
    """What an image says about the pose."""

    model: str = Field(
        "votes",
        description="votes: all headings at once, stands changing light; paper: the paper's voting as printed; the others: methods "
        "that these are compared with.",
    )
    votes: VotesSettings = Field(default_factory=VotesSettings, description="Settings of the model `votes`.")

    @property
    def selected(self) -> Any:
        """The settings of the selected model."""
        return getattr(self, self.model)


def load(entry: str) -> Any:
    """The class at ``module:Class``."""
    module, name = entry.split(":")
    return getattr(importlib.import_module(module), name)


@cache
def all_observation_settings() -> type[ObservationSettings]:
    """`ObservationSettings` with the settings of every model that is installed: a robot may do without the laboratory."""
    installed = {
        name: load(entry.settings)
        for name, entry in MODELS.items()
        if not entry.settings.startswith(_PEERS) or importlib.util.find_spec(_PEERS.rpartition(".")[0]) is not None
    }
    description = ObservationSettings.model_fields["model"].description
    fields: dict[str, Any] = {"model": (Literal[tuple(installed)], Field("votes", description=description))}
    for name, settings in installed.items():
        if name != "votes":
            fields[name] = (settings, Field(default_factory=settings, description=f"Settings of the model `{name}`."))
    doc = ObservationSettings.__doc__
    return create_model("AllObservationSettings", __base__=ObservationSettings, __module__=__name__, __doc__=doc, **fields)


def __getattr__(name: str) -> Any:
    # Where pickle looks the class up.
    if name == "AllObservationSettings":
        return all_observation_settings()
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
