import json
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from oracles.scenes import COLUMNS, ROWS, grid, panorama, texture, turned
from safetensors import safe_open
from safetensors.numpy import save_file

from panoloc_mcl.laboratory.peers.settings import PaperSettings
from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.robot.errors import MapError, PanolocError
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.robot.settings.config import LocalizerConfig, ObservationSettings
from panoloc_mcl.robot.settings.observation import VotesSettings
from panoloc_mcl.tools.datasets import Dataset, read_dataset
from panoloc_mcl.tools.datasets.writer import DatasetWriter

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
IMAGES = [texture(seed) for seed in range(4)]
POSES = np.column_stack([grid(2, 2), np.zeros(4)])
PAPER = ObservationSettings.model_validate(
    {"model": "paper", "paper": PaperSettings(components=3, hypotheses=4, pixels=50, trim_to=30)}
)
QUERY = panorama(turned(IMAGES[2], 14))


def a_dataset(path: Path, images=IMAGES, poses=POSES, camera: PanoramaCamera = CAMERA) -> Dataset:
    writer = DatasetWriter(path, "textures", camera)
    writer.add_references(images, poses)
    return read_dataset(writer.finish())


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return a_dataset(tmp_path / "data")


def same_map(one: PanoramaMap, other: PanoramaMap) -> bool:
    def arrays(built: PanoramaMap) -> list[np.ndarray]:
        return [built.references.pixels, built.references.positions, *(built.arrays[key] for key in sorted(built.arrays))]

    pairs = zip(arrays(one), arrays(other), strict=True)
    return all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in pairs) and sorted(one.arrays) == sorted(other.arrays)


@pytest.mark.parametrize("observation", [ObservationSettings(), PAPER], ids=["votes", "paper"])
def test_a_saved_map_is_loaded_to_the_last_bit(observation: ObservationSettings, dataset: Dataset, tmp_path: Path) -> None:
    built = PanoramaMap.build(dataset, observation, seed=3)
    built.save(tmp_path / "maps" / "textures.panomap")
    loaded = PanoramaMap.load(tmp_path / "maps" / "textures.panomap")
    assert same_map(built, loaded)
    assert (loaded.name, loaded.seed, loaded.image_size) == ("textures", 3, (COLUMNS, ROWS))
    assert loaded.camera == built.camera
    assert loaded.observation == observation
    assert loaded.geometry == built.geometry
    assert loaded.references.names == built.references.names
    one, other = (m.observation_model().observe(QUERY).votes for m in (built, loaded))
    assert np.array_equal(one, other)
    assert one.any()


def test_saving_again_gives_the_same_file(dataset: Dataset, tmp_path: Path) -> None:
    PanoramaMap.build(dataset).save(tmp_path / "a")
    PanoramaMap.load(tmp_path / "a").save(tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_mask_is_kept(tmp_path: Path) -> None:
    built = PanoramaMap.build(a_dataset(tmp_path / "data"))
    valid = np.ones((len(built.references), ROWS, COLUMNS), dtype=bool)
    valid[1:, -4:] = False
    references = type(built.references)(**{**vars(built.references), "valid": valid})
    made = (built.observation, 0, built.arrays, built.keyframes)
    masked = PanoramaMap(built.name, references, built.camera, built.image_size, *made)
    masked.save(tmp_path / "m")
    loaded = PanoramaMap.load(tmp_path / "m").references.valid
    assert loaded is not None
    assert np.array_equal(loaded, valid)


def rewritten(source: Path, target: Path, *, drop: str = "", header=None, metadata=None, tensors=None) -> Path:
    """A map file with parts of it changed."""
    with safe_open(source, framework="numpy") as container:
        kept = {name: container.get_tensor(name) for name in container.keys() if name != drop}  # noqa: SIM118
        old = container.metadata()
    if header is not None:
        old["map"] = header(json.loads(old["map"]))
    save_file({**kept, **(tensors or {})}, target, metadata=old if metadata is None else metadata)
    return target


def without(key: str):
    return lambda header: json.dumps({name: value for name, value in header.items() if name != key})


def with_(**values):
    return lambda header: json.dumps({**header, **values})


DAMAGE = {
    "missing": lambda good, bad: bad,
    "empty": lambda good, bad: bad.write_bytes(b""),
    "text": lambda good, bad: bad.write_text("this is no map"),
    "half": lambda good, bad: bad.write_bytes(good.read_bytes()[: good.stat().st_size // 2]),
    "a byte short": lambda good, bad: bad.write_bytes(good.read_bytes()[:-1]),
    "only a header": lambda good, bad: bad.write_bytes(good.read_bytes()[:64]),
    "folder": lambda good, bad: bad.mkdir(),
    "foreign": lambda good, bad: save_file({"weights": np.zeros(3)}, bad),
    "no metadata": lambda good, bad: rewritten(good, bad, metadata={}),
    "newer": lambda good, bad: rewritten(good, bad, header=with_(format="panoloc-map/99")),
    "no header": lambda good, bad: rewritten(good, bad, metadata={"title": "weights"}),
    "header no JSON": lambda good, bad: rewritten(good, bad, header=lambda _: "{"),
    "header a list": lambda good, bad: rewritten(good, bad, header=lambda _: "[]"),
    "header null": lambda good, bad: rewritten(good, bad, header=lambda _: "null"),
    "no camera": lambda good, bad: rewritten(good, bad, header=without("camera")),
    "camera a word": lambda good, bad: rewritten(good, bad, header=with_(camera="mirror")),
    "camera impossible": lambda good, bad: rewritten(good, bad, header=with_(camera={"kind": "panorama"})),
    "size too short": lambda good, bad: rewritten(good, bad, header=with_(image_size=[60])),
    "unknown model": lambda good, bad: rewritten(good, bad, header=with_(observation={"model": "magic"})),
    "elevations": lambda good, bad: rewritten(good, bad, header=with_(elevation_deg=[25])),
    "no pixels": lambda good, bad: rewritten(good, bad, drop="references.pixels"),
    "flat pixels": lambda good, bad: rewritten(good, bad, tensors={"references.pixels": np.zeros(5, np.uint8)}),
    "too few positions": lambda good, bad: rewritten(good, bad, tensors={"references.positions": np.zeros((3, 2))}),
    "positions are no numbers": lambda good, bad: rewritten(
        good, bad, tensors={"references.positions": np.full((4, 2), np.nan)}
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_file_that_is_no_whole_map_is_one_line(kind: str, dataset: Dataset, tmp_path: Path) -> None:
    good, bad = tmp_path / "good", tmp_path / "bad"
    PanoramaMap.build(dataset).save(good)
    DAMAGE[kind](good, bad)
    with pytest.raises(MapError) as caught:
        PanoramaMap.load(bad)
    (line,) = caught.value.faults
    assert line.startswith(f"{bad}: ")
    assert "\n" not in str(caught.value)


def test_a_part_of_its_model_that_a_map_lacks_is_computed_again(dataset: Dataset, tmp_path: Path) -> None:
    good = PanoramaMap.build(dataset)
    good.save(tmp_path / "good")
    bad = PanoramaMap.load(rewritten(tmp_path / "good", tmp_path / "bad", drop="model.coefficients"))
    with pytest.warns(UserWarning, match="map 'textures': made by an earlier version, without 'coefficients'"):
        again = bad.observation_model()
    for name, array in good.observation_model().arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)


class Bomb:
    def __reduce__(self):
        return (Path.touch, (Path("exploded"),))


@pytest.mark.parametrize("wrap", [pickle.dumps, lambda bomb: np.array([bomb], dtype=object).dumps()])
def test_a_file_is_never_executed(wrap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad").write_bytes(wrap(Bomb()))
    with pytest.raises(MapError):
        PanoramaMap.load(tmp_path / "bad")
    assert not (tmp_path / "exploded").exists()
    pickle.loads((tmp_path / "bad").read_bytes())
    assert (tmp_path / "exploded").exists()  # the file does what it is there for


def test_a_map_that_cannot_be_written_is_one_line_and_leaves_nothing(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PanolocError) as caught:
        PanoramaMap.build(dataset).save(tmp_path / "file" / "map")
    assert len(caught.value.faults) == 1
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["data", "file"]


@pytest.mark.slow
@pytest.mark.parametrize("columns", [(0, 0, 0, 0), (3, 11, 30, 59), (-7, 60, 1, 2)])
def test_references_at_other_headings_give_the_same_map(columns: tuple, dataset: Dataset, tmp_path: Path) -> None:
    poses = POSES.copy()
    poses[:, 2] = 2.0 * np.pi * np.asarray(columns) / COLUMNS
    taken = [turned(image, count) for image, count in zip(IMAGES, columns, strict=True)]
    assert same_map(PanoramaMap.build(dataset), PanoramaMap.build(a_dataset(tmp_path / "turned", taken, poses)))


def test_a_heading_between_columns_gives_nearly_the_same_map(dataset: Dataset, tmp_path: Path) -> None:
    poses = POSES.copy()
    poses[:, 2] = 2.0 * np.pi * 4.5 / COLUMNS
    # Half a column of turn, by Fourier's theorem.
    spectrum = np.fft.rfft(np.stack(IMAGES), axis=2) * np.exp(-2j * np.pi * np.arange(COLUMNS // 2 + 1) * 4.5 / COLUMNS)
    taken = np.clip(np.rint(np.fft.irfft(spectrum, COLUMNS, axis=2)), 0, 255).astype(np.uint8)
    references = read_references(a_dataset(tmp_path / "turned", list(taken), poses).references)
    difference = references.pixels.astype(int) - np.stack(IMAGES).astype(int)
    # Cubic interpolation and rounding, over a contrast of 215.
    assert np.abs(difference).mean() < 2.0


@pytest.mark.slow
def test_the_layout_of_the_columns_does_not_matter(dataset: Dataset, tmp_path: Path) -> None:
    plain = PanoramaMap.build(dataset)
    other = CAMERA.model_copy(update={"columns": "counterclockwise", "heading_column": 17.0})
    # Column c of the plain picture is column 17 - c of the other one.
    index = np.mod(17 - np.arange(COLUMNS), COLUMNS)
    mirrored = [image[:, index] for image in IMAGES]
    same = PanoramaMap.build(a_dataset(tmp_path / "mirrored", mirrored, camera=other))
    assert same_map(plain, same)
    query = turned(IMAGES[1], 9)
    votes, reordered = (
        built.observation_model().observe(built.unwrapper()(image)).votes
        for built, image in ((plain, query), (same, query[:, index]))
    )
    assert np.array_equal(votes, reordered)


def test_another_height_is_refused_and_a_like_one_taken(dataset: Dataset) -> None:
    built = PanoramaMap.build(dataset)
    with pytest.raises(MapError, match=r"height_m = 0\.9") as caught:
        built.unwrapper(CAMERA.model_copy(update={"height_m": 0.9}))
    assert len(caught.value.faults) == 1
    for height in (0.6, 0.65, None):
        assert built.unwrapper(CAMERA.model_copy(update={"height_m": height})).geometry == built.geometry


def test_a_camera_that_looks_elsewhere_is_refused(dataset: Dataset) -> None:
    built = PanoramaMap.build(dataset)
    with pytest.raises(MapError, match="elevation") as caught:
        built.unwrapper(PanoramaCamera(elevation_deg=(0.0, 60.0)))
    assert len(caught.value.faults) == 1
    # One that sees nothing of it at all is refused, too.
    with pytest.raises(PanolocError, match="elevation"):
        built.unwrapper(PanoramaCamera(elevation_deg=(30.0, 60.0)))
    assert built.unwrapper(PanoramaCamera(elevation_deg=(-50.0, 10.0))).valid is not None


@pytest.mark.slow
def test_other_settings_are_computed_from_the_references(dataset: Dataset) -> None:
    built = PanoramaMap.build(dataset)
    signed = ObservationSettings(votes=VotesSettings(gradient="signed"))
    direct = PanoramaMap.build(dataset, signed).observation_model()
    # It takes as long as building the map, so it is said.
    with pytest.warns(UserWarning, match="computed anew") as told:
        model = built.observation_model(signed)
    (line,) = (str(one.message) for one in told)
    assert "observation.votes.gradient = signed and not doubled_angle; " in line
    assert "panoloc build-map --set" in line
    assert np.array_equal(model.observe(QUERY).votes, direct.observe(QUERY).votes)
    with pytest.warns(UserWarning, match=r"than observation.model = paper and not votes; it"):
        assert built.observation_model(PAPER).name == "paper"


def test_settings_that_only_matter_when_an_image_is_looked_at_are_no_others(dataset: Dataset) -> None:
    built = PanoramaMap.build(dataset)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        built.observation_model(ObservationSettings(votes=VotesSettings(min_visible=0.5)))


def test_a_localizer_that_is_given_no_settings_takes_those_of_the_map(dataset: Dataset) -> None:
    built = PanoramaMap.build(dataset, ObservationSettings(votes=VotesSettings(gradient="signed")))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Localizer(built).config.observation == built.observation
    with pytest.warns(UserWarning, match="gradient = doubled_angle and not signed"):
        Localizer(built, LocalizerConfig())


def test_references_that_cannot_be_used_are_one_line_each(tmp_path: Path) -> None:
    images = [np.zeros_like(IMAGES[0]), IMAGES[1], np.full_like(IMAGES[0], 255), IMAGES[3]]
    with pytest.raises(MapError) as caught:
        PanoramaMap.build(a_dataset(tmp_path / "data", images))
    assert len(caught.value.faults) == 2


def test_a_robot_that_stood_gives_several_references_of_one_pose(tmp_path: Path) -> None:
    poses = np.concatenate([POSES, POSES[:1]])
    built = PanoramaMap.build(a_dataset(tmp_path / "data", [*IMAGES, IMAGES[0]], poses=poses))
    assert len(built.references) == len(POSES) + 1
    # The second of them tells nothing new.
    assert built.arrays["used"].tolist() == list(range(len(POSES)))


def test_several_headings_at_one_position_are_welcome(tmp_path: Path) -> None:
    poses = POSES.copy()
    poses[2] = poses[0] + [0.0, 0.0, 0.5]
    assert len(PanoramaMap.build(a_dataset(tmp_path / "data", poses=poses)).references) == 4
