"""Maps with virtual places: built, kept in a file, loaded, and what takes their place when there can be none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.scenes import grid
from threadpoolctl import threadpool_limits

from panoloc_mcl.robot.camera import Panorama, PanoramaCamera
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.files import CACHE_VARIABLE
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.observation import VotesModel
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.robot.settings.config import ObservationSettings
from panoloc_mcl.robot.settings.observation import RefinementSettings, VirtualPlacesSettings, VotesSettings
from panoloc_mcl.tools.datasets import Dataset, read_dataset
from panoloc_mcl.tools.datasets.writer import DatasetWriter
from panoloc_mcl.tools.runs.map_cache import cached_map

VIRTUAL = VirtualPlacesSettings(spacing_m=0.25)
SETTINGS = VotesSettings(virtual_places=VIRTUAL)
OBSERVATION = ObservationSettings(votes=SETTINGS)
TRUTH = np.array([1.3, 0.55, -2.0])


def a_dataset(small, path: Path, height_m: float | None = 0.6, count: int = 6) -> Dataset:
    writer = DatasetWriter(path, "bare room", PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=height_m))
    writer.add_references(list(small.references.pixels[:count]), np.column_stack([grid(3, 2), np.zeros(6)])[:count])
    return read_dataset(writer.finish())


@pytest.fixture(scope="module")
def dataset(small, tmp_path_factory) -> Dataset:
    return a_dataset(small, tmp_path_factory.mktemp("bare") / "data")


@pytest.fixture(scope="module")
def built(dataset) -> PanoramaMap:
    return PanoramaMap.build(dataset, OBSERVATION)


@pytest.fixture(scope="module")
def image(small):
    return small.room.panorama(small.geometry, TRUTH)


def test_one_image_gives_the_pose_between_the_references(built, image) -> None:
    model = built.observation_model()
    assert built.notes == model.notes == ()
    assert len(model.places) > 100
    assert np.array_equal(model.places.references, built.references.positions)
    field = model.observe(image)
    assert np.hypot(*(field.best_pose[:2] - TRUTH[:2])) < 0.2
    assert field.measurement is not None
    assert np.hypot(*(field.measurement.pose[:2] - TRUTH[:2])) < 0.03
    assert abs(angle_difference(field.measurement.pose[2], TRUTH[2])) < np.radians(0.5)


def test_a_loaded_map_says_the_same_to_the_last_bit(built, image, tmp_path: Path) -> None:
    built.save(tmp_path / "bare.panomap")
    loaded = PanoramaMap.load(tmp_path / "bare.panomap")
    with threadpool_limits(1, user_api="blas"):  # as every map is built: sums have one order
        fresh = VotesModel.build(built.references, SETTINGS)
    fields = [model.observe(image) for model in (fresh, built.observation_model(), loaded.observation_model())]
    for field in fields[1:]:
        assert np.array_equal(field.places.positions, fields[0].places.positions)
        assert np.array_equal(field.votes, fields[0].votes)
        assert field.confidence == fields[0].confidence
        assert np.array_equal(field.measurement.agreement.sectors, fields[0].measurement.agreement.sectors)
        for name in ("pose", "covariance", "tilt"):
            assert np.array_equal(getattr(field.measurement, name), getattr(fields[0].measurement, name))


@pytest.mark.parametrize(
    "change",
    [
        lambda used: used + len(used),
        lambda used: used - 1,
        lambda used: used[::-1].copy(),
        lambda used: used.astype(np.float64),
        lambda used: used[:0],
        lambda used: np.where(used == used.max(), 2**60, used),
    ],
)
def test_a_map_whose_views_are_of_references_that_are_not_there_is_refused(built, tmp_path: Path, change) -> None:
    arrays = {**built.arrays, "used": change(np.asarray(built.arrays["used"]))}
    replace(built, arrays=arrays).save(tmp_path / "damaged.panomap")
    with pytest.raises(MapError, match=r"damaged\.panomap.*views are made from references that are not among"):
        PanoramaMap.load(tmp_path / "damaged.panomap")


@pytest.mark.slow
def test_a_map_does_not_depend_on_the_threads(built) -> None:
    rough = VIRTUAL.model_copy(update={"spacing_m": 0.4, "wall_distances": 6})
    one, other = (
        VotesModel.build(
            built.references, SETTINGS.model_copy(update={"virtual_places": rough.model_copy(update={"threads": threads})})
        ).arrays()
        for threads in (1, 3)
    )
    assert sorted(one) == sorted(other)
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_asked_for_some_headings_only_there_is_no_measurement(built, image) -> None:
    model = built.observation_model()
    assert model.observe(image, np.array([0.0, 1.0])).measurement is None
    black = replace(image, pixels=np.zeros_like(image.pixels))
    assert model.observe(black).measurement is None


def test_refinement_can_be_switched_off_without_another_map(built, image, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(VotesModel, "build", None)
    chosen = OBSERVATION.model_copy(
        update={"votes": SETTINGS.model_copy(update={"refinement": RefinementSettings(enabled=False)})}
    )
    field = built.observation_model(chosen).observe(image)
    assert field.measurement is None
    assert np.array_equal(field.votes, built.observation_model().observe(image).votes)


@pytest.mark.parametrize(
    ("height_m", "count", "why"), [(None, 6, "camera.height_m"), (0.6, 1, "single reference")], ids=["height", "single"]
)
def test_without_depth_the_references_are_the_places_and_the_map_says_so(
    height_m, count: int, why: str, small, image, tmp_path: Path
) -> None:
    dataset = a_dataset(small, tmp_path / "data", height_m, count)
    built = PanoramaMap.build(dataset, ObservationSettings())
    model = VotesModel.build(built.references, VotesSettings())
    assert len(built.notes) == 2
    assert built.notes[0].startswith("poses not mended: ")
    assert model.notes == built.notes[1:]
    assert model.notes[0].startswith("no virtual places: ")
    assert why in model.notes[0]
    built.save(tmp_path / "map")
    loaded = PanoramaMap.load(tmp_path / "map")
    assert loaded.notes == built.notes
    for places in (model.places, loaded.observation_model().places):
        assert np.array_equal(places.positions, built.references.positions)
    field = loaded.observation_model().observe(image)
    assert field.informative
    assert field.measurement is None


def test_switched_off_they_need_no_note(small) -> None:
    model = VotesModel.build(small.references, VotesSettings(virtual_places=VirtualPlacesSettings(enabled=False)))
    assert model.notes == ()
    assert len(model.places) == 6


@pytest.mark.slow
def test_a_map_that_was_built_without_refinement_knows_what_refined_poses_are_worth(dataset) -> None:
    off = SETTINGS.model_copy(update={"refinement": RefinementSettings(enabled=False)})
    with_it, without = (
        VotesModel.build(read_references(dataset.references), settings).arrays() for settings in (SETTINGS, off)
    )
    assert with_it.keys() == without.keys()
    for name, array in with_it.items():
        np.testing.assert_array_equal(array, without[name], err_msg=name)
    # As an earlier version left it behind.
    before = {**with_it, "calibration": np.where(np.arange(len(with_it["calibration"])) < 8, with_it["calibration"], 0.0)}
    for settings in (SETTINGS, off):
        with pytest.raises(KeyError, match="calibration"):
            VotesModel.restore(read_references(dataset.references), settings, before)


OBSERVING = [
    {"tolerance": 0.3},
    {"vote_width": 0.5},
    {"refinement": RefinementSettings(sources=3)},
    {"refinement": RefinementSettings(enabled=False)},
    {"virtual_places": VIRTUAL.model_copy(update={"threads": 1})},
]
BUILDING = [
    {"contrast_floor": 5.0},
    {"bandwidth": 0.5},
    {"virtual_places": VIRTUAL.model_copy(update={"spacing_m": 0.5})},
    {"virtual_places": VIRTUAL.model_copy(update={"wall_distances": 8})},
    {"virtual_places": VirtualPlacesSettings(enabled=False)},
]


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "builds_expected"), [*((c, 1) for c in OBSERVING), *((c, 2) for c in BUILDING)], ids=str)
def test_only_what_a_map_depends_on_builds_it_again(
    changes, builds_expected: int, dataset, image, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    builds: list[int] = []
    build = VotesModel.build.__func__  # type: ignore[attr-defined]  # the function that the class method wraps

    def counted(cls, *arguments, **more):
        builds.append(1)
        return build(cls, *arguments, **more)

    monkeypatch.setattr(VotesModel, "build", classmethod(counted))
    # Few places and distances: what is built does not matter here.
    quick = SETTINGS.model_copy(update={"virtual_places": VIRTUAL.model_copy(update={"spacing_m": 0.4, "wall_distances": 4})})
    if "virtual_places" in changes and builds_expected == 1:
        changes = {"virtual_places": quick.virtual_places.model_copy(update={"threads": 1})}
    cached_map(dataset, ObservationSettings(votes=quick), 0)
    other = ObservationSettings(votes=quick.model_copy(update=changes))
    found = cached_map(dataset, other, 0)
    model = found.observation_model(other)
    assert len(builds) == builds_expected
    # Whichever map it is, the image is looked at with the settings asked for.
    assert isinstance(model, VotesModel)
    assert model.settings == other.votes
    assert model.observe(image).informative


def test_a_true_image_is_believed_and_one_of_nowhere_is_not(built, image) -> None:
    model = built.observation_model()
    true = model.observe(image)
    assert true.confidence > 0.8
    assert true.informative
    nowhere = model.observe(Panorama(np.random.default_rng(5).uniform(20, 235, image.pixels.shape).astype(np.float32)))
    assert nowhere.confidence < 0.5
    assert nowhere.problem.startswith("image fits nowhere in the map (confidence ")


def test_a_map_does_without_a_reference_where_views_are_synthesised(built) -> None:
    model = built.observation_model()
    held_out = model.held_out(1)
    panorama = built.references.panorama(1)
    with_it, without = model.observe(panorama), held_out.observe(panorama)
    assert np.hypot(*(without.best_pose[:2] - built.references.positions[1])) < 0.3
    assert without.peak.votes < with_it.peak.votes
    assert np.isnan(without.confidence)


def test_without_views_a_reference_that_is_held_out_is_no_place(built) -> None:
    settings = SETTINGS.model_copy(update={"virtual_places": VirtualPlacesSettings(enabled=False)})
    model = VotesModel.build(built.references, settings)
    left = model.held_out(0).places.positions
    assert np.array_equal(left, np.delete(model.places.positions, 0, axis=0))
