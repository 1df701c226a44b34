from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.laboratory.corruptions import IMPERFECTIONS, LEVELS, corrupt, images, parse_recipe
from panoloc_mcl.laboratory.corruptions.draft import View, draft_of
from panoloc_mcl.laboratory.corruptions.lens import levels_of, light_of
from panoloc_mcl.laboratory.corruptions.sight import sight_of
from panoloc_mcl.robot.camera import OmniCamera, PanoramaCamera, PanoramaGeometry, Unwrapper
from panoloc_mcl.robot.camera.spec import EquirectangularCamera, FisheyePairCamera, LensCamera
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.geometry import between, compose
from panoloc_mcl.robot.images import read_image
from panoloc_mcl.robot.references import read_references
from panoloc_mcl.tools.datasets import read_dataset

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)
SIZE = (120, 50)
OMNI = OmniCamera(
    center_px=(120.3, 118.8),
    valid_radius_px=(28.0, 117.0),
    heading_angle_deg=70.0,
    azimuth="clockwise",
    profile={"kind": "linear", "points": [[-50.0, 28.0], [25.0, 117.0]]},
    panorama={"size": SIZE, "elevation_deg": (-50.0, 25.0)},
    height_m=0.6,
)
SPHERE = EquirectangularCamera(height_m=0.6)
_KB = {"kind": "kannala_brandt", "fx": 60.0, "fy": 61.0, "cx": 119.2, "cy": 120.4, "k": (0.02, -0.01, 0.001, 0.0)}
LENS = LensCamera(lens=_KB, looks="up", valid_radius_px=(0.0, 110.0))
_HALF = {"kind": "kannala_brandt", "fx": 38.0, "fy": 38.0, "cx": 59.5, "cy": 59.5}
PAIR = FisheyePairCamera(front={"lens": _HALF}, back={"lens": _HALF, "offset_px": (120.0, 0.0)})
SIZES = {"omni": (240, 240), "equirectangular": (240, 120), "fisheye_pair": (240, 120)}
CAMERAS = pytest.mark.parametrize(
    "camera", [CAMERA, OMNI, SPHERE, LENS, PAIR], ids=["panorama", "omni", "sphere", "lens", "pair"]
)
MIRRORED = PanoramaCamera(elevation_deg=(-40.0, 30.0), columns="counterclockwise", heading_column=17.5)


_SIGHTS: dict[tuple[type, tuple[int, int]], Any] = {}


def a_view(camera=CAMERA, size=SIZE, pose=(0.3, -0.2, 0.4), copy=0, time=0.0):
    rng = np.random.default_rng((5, copy))
    # Searching for the rays of a lens takes a second.
    sight = _SIGHTS.setdefault((type(camera), size), None) or sight_of(camera, size)
    _SIGHTS[type(camera), size] = sight
    return View(sight, np.array(pose), 0.6, time, False, rng, (7, 3))


def a_light(size=SIZE, seed=0, sigma=2.0):
    noise = np.random.default_rng(seed).standard_normal((size[1], size[0]))
    smooth = cv2.GaussianBlur(np.tile(noise, (1, 3)), (0, 0), sigma)[:, size[0] : 2 * size[0]]
    return (0.3 + 0.25 * np.clip(smooth / smooth.std(), -1.0, 1.0)).astype(np.float32)[..., None]


def the_use(text):
    return parse_recipe(text).uses[0].settings


@pytest.mark.parametrize("camera", [CAMERA, MIRRORED, OMNI, SPHERE, LENS, PAIR], ids=lambda camera: type(camera).__name__)
def test_rays_lead_back_to_their_pixels(camera):
    size = SIZES.get(camera.kind, SIZE)
    sight = sight_of(camera, size)
    assert sight.seen.mean() > 0.4
    column, row = sight.pixels_of(sight.azimuth, sight.elevation)
    v, u = np.nonzero(sight.seen)
    off = np.abs(column[sight.seen] - u)
    np.testing.assert_allclose(np.minimum(off, size[0] - off), 0.0, atol=1e-2)
    np.testing.assert_allclose(row[sight.seen], v, atol=1e-2)


@pytest.mark.parametrize("camera", [CAMERA, MIRRORED, OMNI, SPHERE, PAIR], ids=lambda camera: type(camera).__name__)
def test_rays_are_those_that_the_localizer_unwraps_by(camera):
    """A picture of its own elevations and azimuths, unwrapped, shows those of the canonical panorama."""
    size = SIZES.get(camera.kind, SIZE)
    sight = sight_of(camera, size)
    geometry = PanoramaGeometry(120, 50, -35.0, 20.0)
    for value, wanted in (
        (np.degrees(sight.elevation) + 100.0, np.degrees(geometry.elevation_of_row(np.arange(50)))[:, None] + 100.0),
        (60.0 * np.sin(sight.azimuth) + 100.0, 60.0 * np.sin(geometry.azimuth_of_column(np.arange(120)))[None] + 100.0),
    ):
        seen = np.where(sight.seen, value, 0.0)
        unwrapped = Unwrapper(camera, size, geometry)((100.0 * seen).astype(np.uint16))
        found = unwrapped.pixels * (65535.0 / 255.0 / 100.0)
        inner = np.ones(found.shape, bool) if unwrapped.valid is None else _shrunk(unwrapped.valid)
        inner[:2] = inner[-2:] = False
        assert inner.mean() > 0.7
        np.testing.assert_allclose(found[inner], np.broadcast_to(wanted, found.shape)[inner], atol=1.0)


def _shrunk(valid):
    """Without what lies near to where the camera sees nothing: pixels there are mixed with black."""
    blocked = cv2.dilate(np.tile(~valid, (1, 3)).astype(np.uint8), np.ones((5, 9), np.uint8))
    return blocked[:, valid.shape[1] : 2 * valid.shape[1]] == 0


def test_a_tilted_camera_sees_what_the_leaning_one_of_single_images_sees():
    light = a_light(sigma=5.0)
    use = the_use("mount_tilt:mild,degrees=4,towards_deg=0")
    found = levels_of(use(light, a_view()))
    wanted = images.lean(levels_of(light), np.random.default_rng(0), 4.0, 0.0, (-50.0, 25.0))
    assert np.abs(found.astype(int) - wanted)[6:-6].mean() < 1.0
    assert np.abs(levels_of(light).astype(int) - wanted)[6:-6].mean() > 5.0


def test_a_panorama_off_centre_is_one_unwrapped_around_the_wrong_centre():
    """The oracle is the localizer's own unwrapping of a raw image whose centre is claimed wrong."""
    ring = {"kind": "linear", "points": [[-50.0, 28.0], [25.0, 237.0]]}
    raw = OMNI.model_copy(update={"center_px": (250.0, 250.0), "valid_radius_px": (28.0, 237.0), "azimuth": "counterclockwise"})
    raw = OmniCamera.model_validate({**raw.model_dump(), "profile": ring, "heading_angle_deg": 90.0})
    sight = sight_of(raw, (501, 501))
    scene = 128.0 + 60.0 * np.sin(3.0 * sight.azimuth + 1.0) * np.cos(4.0 * sight.elevation)
    picture = np.where(sight.seen, scene, 0.0).astype(np.uint8)
    geometry = PanoramaGeometry(360, 145, -50.0, 25.0)
    pixels = 5.0
    use = the_use(f"centre:mild,pixels={pixels},towards_deg=30")
    right = Unwrapper(raw, (501, 501), geometry)(picture).pixels
    # In the image up is the heading, so an azimuth of 30 degrees is 120 from +u.
    off = pixels * np.array([np.cos(np.radians(120.0)), np.sin(np.radians(120.0))])
    claimed = raw.model_copy(update={"center_px": (250.0 + off[0], 250.0 - off[1])})
    wrong = Unwrapper(claimed, (501, 501), geometry)(picture).pixels
    found = use((right[..., None] / 255.0).astype(np.float32), a_view(size=(360, 145)))[..., 0] * 255.0
    assert np.abs(found - wrong)[5:-5].mean() < 1.0
    assert np.abs(right - wrong)[5:-5].mean() > 3.0


@CAMERAS
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", [name for name, one in IMPERFECTIONS.items() if not one.changes_data])
def test_every_disturbance_of_images_by_level(name, level, camera):
    size = SIZES.get(camera.kind, (240, 100))
    light, view = a_light(size, sigma=1.0), a_view(camera, size)
    before = light.copy()
    disturbed = the_use(f"{name}:{level}")(light, view)
    np.testing.assert_array_equal(light, before)
    assert disturbed.dtype == np.float32
    assert disturbed.shape == light.shape
    assert np.isfinite(disturbed).all()
    assert not np.array_equal(levels_of(disturbed), levels_of(light))
    again = the_use(f"{name}:{level}")(light, a_view(camera, size))
    np.testing.assert_array_equal(again, disturbed)


@pytest.mark.parametrize("name", [name for name, one in IMPERFECTIONS.items() if not one.changes_data])
def test_strong_is_more_than_mild(name):
    light = a_light(sigma=1.0)
    changes = [
        np.abs(levels_of(the_use(f"{name}:{level}")(light, a_view())).astype(float) - levels_of(light)) for level in LEVELS
    ]
    # Exposure is drawn: two draws of one generator, of other widths.
    assert changes[0].mean() < changes[1].mean()


def test_motion_blur_is_the_mean_over_the_columns_that_the_camera_turns_by():
    light = a_light()
    found = the_use("motion_blur:strong,degrees=9")(light, a_view())
    np.testing.assert_allclose(found, np.mean([np.roll(light, k, axis=1) for k in (-1, 0, 1)], axis=0), atol=1e-6)
    # An even width takes half of the columns at its ends, so that nothing moves.
    for degrees in (5.0, 6.0, 24.0):
        spot = np.zeros((50, 120, 1), dtype=np.float32)
        spot[:, 60] = 1.0
        blurred = the_use(f"motion_blur:mild,degrees={degrees}")(spot, a_view())[20, :, 0]
        assert blurred.sum() == pytest.approx(1.0, abs=1e-6)
        assert blurred @ np.arange(120) == pytest.approx(60.0, abs=1e-5)
        assert (blurred > 1e-9).sum() == 2 * np.ceil(0.5 * (degrees / 3.0 - 1.0)) + 1
    raw = a_light((240, 240))
    turned = the_use("motion_blur:strong,degrees=9")(raw, a_view(OMNI, (240, 240)))
    assert np.isfinite(turned).all()


@given(share=st.floats(0.0, 0.5), seed=st.integers(0, 100))
@settings(max_examples=20, deadline=None)
def test_people_hide_the_share_of_columns_at_most(share, seed):
    light = np.full((50, 120, 1), 0.3, dtype=np.float32)
    view = a_view(time=float(seed))
    people = the_use("people:mild").model_copy(update={"share": share})
    hidden = (people(light, view) != light).any(axis=(0, 2)).mean()
    # Those who walk behind others hide nothing more; borders are whole columns.
    assert hidden <= share + 0.1
    assert (hidden > 0.0) == (share > 0.02) or 0.0 < share <= 0.02


def test_the_body_stays_in_the_cameras_frame_and_takes_the_light_of_the_place():
    body = the_use("body:strong")
    one, other = a_view(pose=(0, 0, 0)), a_view(pose=(3, 1, 2), copy=4)
    hidden = body.hides(one.sight)
    bright = a_light()
    np.testing.assert_array_equal(body(bright, one)[hidden], body(bright, other)[hidden])
    np.testing.assert_allclose(body(0.5 * bright, one)[hidden], 0.5 * body(bright, one)[hidden], rtol=1e-5)
    np.testing.assert_array_equal(body(bright, one)[~hidden], bright[~hidden])
    columns = hidden[:30].all(axis=0).sum()
    assert columns == pytest.approx(20.0 / 3.0, abs=1.0)
    assert hidden.mean() < 0.35


def test_leaves_hang_in_the_world():
    """From half a metre on, near leaves are seen in other directions and far ones nearly in the same; a turn only turns them."""
    foliage = the_use("foliage:strong,per_m3=3")
    light = np.full((50, 120, 1), 0.3, dtype=np.float32)
    here = foliage(light, a_view(pose=(0.0, 0.0, 0.0)))
    turned = foliage(light, a_view(pose=(0.0, 0.0, np.pi / 2)))
    # Turning left by a quarter moves everything clockwise, which is to the right, by a quarter of the columns.
    np.testing.assert_allclose(np.roll(here, 30, axis=1), turned, atol=1e-5)
    there = foliage(light, a_view(pose=(0.5, 0.0, 0.0)))
    assert np.corrcoef(here.ravel(), there.ravel())[0, 1] < 0.5


def test_a_mirror_floor_shows_what_stands_above_it():
    light = np.full((50, 120, 1), 0.2, dtype=np.float32)
    light[:16, 40:50] = 0.9
    mirrored = the_use("reflections:strong")(light, a_view())
    elevation = np.degrees(sight_of(CAMERA, SIZE).elevation[:, 0])
    floor = (elevation < -15.0) & (elevation > -24.0)
    assert (mirrored[floor, 45] > mirrored[floor, 70] + 0.05).all()
    # Seen steeply, little of it is left, and above the horizon nothing.
    assert (mirrored[-1] - light[-1]).max() < 0.1
    np.testing.assert_array_equal(mirrored[elevation > 0], light[elevation > 0])


def test_the_base_carries_the_camera(small_room):
    draft = draft_of(small_room)
    cameras, driven = draft.references.claimed.copy(), draft.drives["noon_00"].groundtruth.poses.copy()
    mount = the_use("mount_yaw:strong")
    mount.change(draft, np.random.default_rng(0))
    on_base = np.array([mount.x_m, mount.y_m, np.radians(mount.yaw_deg)])
    np.testing.assert_allclose(compose(draft.references.claimed, on_base), cameras, atol=1e-12)
    np.testing.assert_allclose(compose(draft.drives["noon_00"].groundtruth.poses, on_base), driven, atol=1e-12)


def test_surveys_err_as_much_as_they_say(small_room):
    claimed = small_room.references.poses
    errors = []
    for seed in range(200):
        draft = draft_of(small_room)
        the_use("pose_noise:strong").change(draft, np.random.default_rng(seed))
        errors.append(draft.references.claimed - claimed)
    sd = np.std(errors, axis=(0, 1))
    np.testing.assert_allclose(sd, [0.1, 0.1, np.radians(2.0)], rtol=0.1)
    draft = draft_of(small_room)
    the_use("pose_drift:strong").change(draft, np.random.default_rng(1))
    np.testing.assert_array_equal(draft.references.claimed[0], claimed[0])
    away = np.hypot(*(draft.references.claimed - claimed)[:, :2].T)
    assert 0.01 < away[-1] < 1.0


def test_headings_are_coarse_and_said_to_be_or_missing(small_room, tmp_path):
    coarse = read_dataset(corrupt(small_room, parse_recipe("headings:mild"), 0, tmp_path / "coarse")).references
    assert 5.0 < np.degrees(np.std(coarse.poses[:, 2])) < 40.0
    np.testing.assert_allclose(coarse.sds[:, 1], np.radians(20.0))
    missing = read_dataset(corrupt(small_room, parse_recipe("headings:strong"), 0, tmp_path / "missing")).references
    assert np.isinf(missing.sds[:, 1]).all()
    np.testing.assert_allclose(missing.poses[:, :2], small_room.references.poses[:, :2], atol=1e-6)


def test_wheels_and_clocks(small_room):
    draft = draft_of(small_room)
    before = draft.drives["noon_00"].odometry
    for use in parse_recipe("odometry:strong+clock:strong").uses:
        use.apply(draft, np.random.default_rng(0))
    after = draft.drives["noon_00"].odometry
    np.testing.assert_allclose(after.times, before.times - 0.3)
    steps, said = between(before.poses[:-1], before.poses[1:]), between(after.poses[:-1], after.poses[1:])
    length = np.hypot(*steps[:, :2].T)
    np.testing.assert_allclose(np.hypot(*said[:, :2].T), 1.15 * length, atol=1e-9)
    np.testing.assert_allclose(said[:, 2] - steps[:, 2], np.radians(6.0) * length, atol=1e-9)


@pytest.mark.parametrize(
    "text", ["doubled:strong+standing:mild", "body:mild+jpeg:strong", "along_drive:mild", "everything:strong"]
)
def test_a_corrupted_data_set_is_one_like_any_other(small_room, tmp_path, text):
    second = dict(small_room.sequences)
    second["noon_01"] = replace(small_room.sequences["noon_00"], name="noon_01")
    source = replace(small_room, sequences=second)
    written = read_dataset(corrupt(source, parse_recipe(text), 3, tmp_path / "out", ["noon_01"]))
    assert list(written.sequences) == ["noon_01"]
    drive, before = written.sequences["noon_01"], small_room.sequences["noon_00"]
    np.testing.assert_array_equal(drive.times, before.times)
    assert written.camera.height_m == pytest.approx(small_room.camera.height_m + (0.1 if "every" in text else 0.0))
    if text.startswith("doubled"):
        # A stop may stand at a second image of a place, too.
        assert len(written.references) == 24 + 3 * 4
        assert len({tuple(pose) for pose in written.references.poses}) == 24
    if text.startswith("along"):
        np.testing.assert_allclose(written.references.poses[0], before.groundtruth.at(before.times[0]), atol=1e-8)
    if text.startswith("body"):
        images_alike = [read_image(a).shape == read_image(b).shape for a, b in zip(drive.files, before.files, strict=True)]
        assert all(images_alike)
        assert not np.array_equal(read_image(drive.files[0]), read_image(before.files[0]))


def test_an_image_comes_out_the_same_whichever_others_do(small_room, tmp_path):
    recipe = parse_recipe("people:strong+sensor:strong+exposure:strong")
    whole = read_dataset(corrupt(small_room, recipe, 3, tmp_path / "whole"))
    drive = small_room.sequences["noon_00"]
    short = replace(small_room, sequences={"noon_00": replace(drive, times=drive.times[::3], files=drive.files[::3])})
    part = read_dataset(corrupt(short, recipe, 3, tmp_path / "part"))
    for a, b in zip(whole.sequences["noon_00"].files[::3], part.sequences["noon_00"].files, strict=True):
        assert a.read_bytes() == b.read_bytes()
    other = read_dataset(corrupt(small_room, recipe, 4, tmp_path / "other"))
    assert other.sequences["noon_00"].files[0].read_bytes() != whole.sequences["noon_00"].files[0].read_bytes()


def test_what_is_not_touched_is_copied_to_the_last_byte(small_room, tmp_path):
    written = read_dataset(corrupt(small_room, parse_recipe("people:mild"), 0, tmp_path / "out"))
    for a, b in zip(written.references.files, small_room.references.files, strict=True):
        assert a.read_bytes() == b.read_bytes()


def test_what_is_told_of_the_mounting_undoes_it(small_room, tmp_path):
    """The oracle is the localizer's reading of references: with mount and tilt told, they are the panoramas that they were."""
    recipe = parse_recipe("mount_yaw:strong+mount_tilt:strong+told")
    written = read_dataset(corrupt(small_room, recipe, 0, tmp_path / "out"))
    assert written.camera.mount.x_m == 0.15
    before, after = (read_references(dataset.references) for dataset in (small_room, written))
    np.testing.assert_allclose(after.positions, before.positions, atol=1e-9)
    rows = slice(4, -4)
    off = np.abs(after.pixels.astype(float) - before.pixels)[:, rows]
    untold = read_dataset(corrupt(small_room, parse_recipe("mount_yaw:strong+mount_tilt:strong"), 0, tmp_path / "untold"))
    wrong = np.abs(read_references(untold.references).pixels.astype(float) - before.pixels)[:, rows]
    assert off.mean() < 0.35 * wrong.mean()


def test_what_is_told_of_the_body_is_its_mask(small_room, tmp_path):
    written = read_dataset(corrupt(small_room, parse_recipe("body:strong+told"), 0, tmp_path / "out"))
    hidden = the_use("body:strong").hides(sight_of(small_room.camera, small_room.references.image_size))
    for camera in (written.camera, written.references.camera, written.sequences["noon_00"].camera):
        np.testing.assert_array_equal(camera.mask.world, ~hidden)


def test_what_is_told_of_clocks_brings_images_and_odometry_together(small_room, tmp_path):
    written = read_dataset(corrupt(small_room, parse_recipe("clock:strong+told"), 0, tmp_path / "out"))
    drive, before = written.sequences["noon_00"], small_room.sequences["noon_00"]
    np.testing.assert_allclose(drive.times, before.times - 0.3)
    np.testing.assert_allclose(drive.odometry.at(drive.times), before.odometry.at(before.times), atol=1e-6)
    np.testing.assert_allclose(drive.groundtruth.at(drive.times), before.groundtruth.at(before.times), atol=1e-6)


def test_what_is_told_of_surveys_is_how_good_they_are(small_room, tmp_path):
    recipe = parse_recipe("pose_noise:strong+doubled:mild+standing:mild+told")
    written = read_dataset(corrupt(small_room, recipe, 0, tmp_path / "out")).references
    assert written.sds is not None
    assert written.sds.shape == (len(written), 2)
    np.testing.assert_allclose(written.sds, np.tile([0.1, np.radians(2.0)], (len(written), 1)))
    again = read_dataset(
        corrupt(read_dataset(tmp_path / "out"), parse_recipe("doubled:strong"), 0, tmp_path / "again")
    ).references
    assert again.sds.shape == (2 * len(written), 2)


def test_a_camera_that_is_told_of_is_calibrated(small_room, tmp_path):
    recipe = parse_recipe("height:strong+elevation_shift:strong+elevation_scale:strong+centre:strong+told")
    written = read_dataset(corrupt(small_room, recipe, 0, tmp_path / "out"))
    assert written.camera == small_room.camera
    assert written.sequences["noon_00"].camera == small_room.camera


def test_everything_is_all_that_come_together_each_once_and_in_their_order():
    recipe = parse_recipe("everything:mild")
    names = [use.name for use in recipe.uses]
    assert names == [name for name, one in IMPERFECTIONS.items() if one.together]
    assert parse_recipe("jpeg:mild+people:mild").uses[0].name == "people"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("body", "body: level is missing; write body:mild or body:strong"),
        ("body:huge", "level = 'huge': is no level"),
        ("body:mild,strut_dge=3", "did you mean 'strut_deg'?"),
        ("everything:mild,strut_deg=3", "everything takes no 'strut_deg'"),
        ("jpeg:mild,where=there", "where = 'there'; use one of both, references, drives"),
        ("centre:mild,where=there", "where = 'there'"),
        ("jpeg:mild+jpeg:strong", "'jpeg' is given twice"),
        ("told", "has no imperfection that could be told of"),
        ("jpg:mild", "did you mean 'jpeg'?"),
        ("jpeg:strong,quality=0", "quality = 0"),
    ],
)
def test_faults_of_imperfections(text, said):
    with pytest.raises(ConfigError) as caught:
        parse_recipe(text)
    (fault,) = caught.value.faults
    assert fault.startswith(f"corruption '{text}': ")
    assert said in fault


def test_what_a_data_set_has_not(small_room, tmp_path):
    with pytest.raises(ConfigError, match="along_drive: needs a sequence with ground truth"):
        corrupt(small_room, parse_recipe("along_drive:mild"), 0, tmp_path / "out")
    with pytest.raises(ConfigError, match=r"puts the camera of .* below the floor"):
        corrupt(small_room, parse_recipe("height:mild,metres=-2"), 0, tmp_path / "out")


def test_light_and_levels_are_each_other_undone():
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    np.testing.assert_array_equal(levels_of(light_of(levels)), levels)
    colours = np.random.default_rng(0).integers(0, 256, (4, 5, 3), dtype=np.uint8)
    np.testing.assert_array_equal(levels_of(light_of(colours)), colours)


def test_the_page_on_comparisons_lists_all_of_them_as_they_are():
    page = (Path(__file__).parents[3] / "docs" / "how-to" / "compare.md").read_text(encoding="utf-8")
    rows = {row.split("`")[1]: row for row in page.splitlines() if row.startswith("| `")}
    assert set(rows) >= set(IMPERFECTIONS)
    for name, one in IMPERFECTIONS.items():
        mild, strong = (", ".join(f"{key} {value:g}" for key, value in one.at(level).items()) for level in LEVELS)
        assert rows[name].endswith(f"| {mild} | {strong} |")
        assert ("·" in rows[name]) != one.together
