"""The resolution is that of the information: not of the file, and not of noise."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from oracles.rooms import BareRoom
from oracles.scenes import grid

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.observation import VotesModel, scale
from panoloc_mcl.robot.observation.scale import _shapes, at_resolution, detail_columns, references_at, resolution_of
from panoloc_mcl.robot.references import ReferencePanoramas
from panoloc_mcl.robot.settings.observation import VotesSettings

SETTINGS = VotesSettings()
GEOMETRY = PanoramaGeometry(120, 48, -50.0, 25.0)


@pytest.fixture(scope="module")
def sharp() -> ReferencePanoramas:
    return BareRoom(low=(-1.5, -1.2), high=(4.6, 3.7)).references(GEOMETRY, grid(4, 3))


def enlarged(world: ReferencePanoramas, factor: int) -> ReferencePanoramas:
    """Every image so many times as large, by interpolation; column 0 looks along the heading as before."""
    geometry = world.geometry
    wide = PanoramaGeometry(
        factor * geometry.width, factor * geometry.height, geometry.elevation_bottom_deg, geometry.elevation_top_deg
    )
    margin = 4
    columns = margin + np.arange(wide.width) / factor
    rows = geometry.row_of_elevation(wide.elevation_of_row(np.arange(wide.height)))
    u, v = (part.astype(np.float32) for part in np.meshgrid(columns, rows))
    padded = [np.hstack([one[:, -margin:], one, one[:, :margin]]) for one in world.pixels]
    pixels = np.stack([cv2.remap(one, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE) for one in padded])
    return replace(world, pixels=pixels, geometry=wide)


def test_sharp_images_are_compared_as_they_are(sharp) -> None:
    assert resolution_of(sharp, SETTINGS) == (48, 120)
    assert references_at(sharp, (48, 120)) is sharp


@pytest.mark.parametrize("factor", [2, 3])
def test_enlarging_the_images_changes_nothing(sharp, factor: int) -> None:
    large = enlarged(sharp, factor)
    assert detail_columns(large) == pytest.approx(120.0, rel=0.25)
    assert resolution_of(large, SETTINGS) == (48, 120)
    back = references_at(large, (48, 120))
    assert np.abs(back.pixels.astype(int) - sharp.pixels).mean() < 3.0


@pytest.mark.slow
def test_where_fine_structure_is_noise_coarser_pixels_are_compared(sharp) -> None:
    large = enlarged(sharp, 2)
    noisy = np.clip(large.pixels + np.random.default_rng(0).normal(0.0, 50.0, large.pixels.shape), 5, 250).astype(np.uint8)
    # By their spectra they have detail; but it is another one in each.
    assert detail_columns(replace(large, pixels=noisy)) > 200.0
    assert resolution_of(replace(large, pixels=noisy), SETTINGS)[1] < 240


@pytest.mark.parametrize("width", [1440, 2000, 4096])
def test_larger_images_are_brought_to_a_working_size(width: int) -> None:
    """However much they show: twice the columns cost four times the time and tell hardly more."""
    first = next(iter(_shapes((round(width * 290 / 720), width), float(width))))
    assert 480 <= first[1] <= 720
    assert first[0] / first[1] == pytest.approx(290 / 720, rel=0.01)


def test_larger_images_are_brought_to_that_size_once(sharp, monkeypatch) -> None:
    """What they show is compared at several resolutions, none of which is theirs: that was half of the time to build a map."""
    widths, deflections = [], scale._deflections

    def watched(group: ReferencePanoramas, shape: tuple[int, int], settings: VotesSettings):
        widths.append(group.geometry.width)
        return deflections(group, shape, settings)

    monkeypatch.setattr(scale, "_deflections", watched)
    assert resolution_of(enlarged(sharp, 3), SETTINGS) == (48, 120)
    assert set(widths) == {120}


def test_a_setting_has_the_last_word(sharp) -> None:
    assert resolution_of(sharp, VotesSettings(columns=90)) == (36, 90)
    assert resolution_of(sharp, VotesSettings(columns=1000)) == (48, 120)


def test_a_pixel_is_the_mean_of_those_it_covers_and_unseen_where_one_is() -> None:
    pixels = np.random.default_rng(1).uniform(0.0, 255.0, (12, 24)).astype(np.float32)
    valid = np.ones((12, 24), dtype=np.bool_)
    valid[3, 4] = False
    small = at_resolution(Panorama(pixels * valid, valid), (4, 8))
    # Column 0 keeps its centre: it covers the last column and the first two.
    means = np.roll(pixels, 1, axis=1).reshape(4, 3, 8, 3).mean(axis=(1, 3))
    assert small.valid is not None
    assert np.argwhere(~small.valid).tolist() == [[1, 1]]
    assert small.pixels[small.valid] == pytest.approx(means[small.valid], rel=1e-4)
    assert small.pixels[1, 1] == 0.0


@pytest.mark.parametrize("columns", [720, 240, 180, 120, 100, 36])
def test_every_column_looks_where_the_geometry_says(columns: int) -> None:
    """Half a column aside, the map's directions are as wrong: two metres from a reference, by millimetres to centimetres."""
    before, after = PanoramaGeometry(360, 24, -50.0, 25.0), PanoramaGeometry(columns, 12, -50.0, 25.0)
    bearing = 0.7
    picture = 100.0 + 50.0 * np.cos(before.azimuth_of_column(np.arange(360)) - bearing)
    small = at_resolution(Panorama(np.tile(picture, (24, 1)).astype(np.float32)), after.shape)
    azimuths = after.azimuth_of_column(np.arange(columns))
    brightest = np.angle(np.exp(1j * azimuths) @ small.pixels.mean(axis=0))
    assert np.degrees(brightest - bearing) == pytest.approx(0.0, abs=0.005)


@pytest.mark.parametrize("waves", [8, 20])
def test_a_column_that_begins_within_another_is_as_sharp_as_one_that_does_not(waves: int) -> None:
    """Half as many columns: each of the wide ones begins in the middle of a narrow one."""
    phase = 2.0 * np.pi * waves * np.arange(240) / 240
    small = at_resolution(Panorama(np.tile(np.cos(phase), (8, 1)).astype(np.float32)), (8, 120))
    spectrum = np.abs(np.fft.rfft(small.pixels[0])) / 60
    # What the mean over a pixel of twice the width leaves of such a wave.
    kept = np.cos(np.pi * waves / 240)
    assert spectrum[waves] == pytest.approx(kept, abs=0.02)


@pytest.mark.slow
def test_a_model_takes_images_of_the_size_of_its_references(sharp) -> None:
    settings = VotesSettings(columns=60, calibration_references=0)
    model = VotesModel.build(sharp, settings)
    restored = VotesModel.restore(sharp, settings, model.arrays())
    fields = [each.observe(sharp.panorama(5)) for each in (model, restored)]
    assert fields[0].votes.shape[0] == 60
    assert np.array_equal(fields[0].votes, fields[1].votes)
    assert np.hypot(*(fields[0].best_pose[:2] - sharp.positions[5])) < 0.1
