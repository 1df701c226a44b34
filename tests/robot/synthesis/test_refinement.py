from dataclasses import replace

import numpy as np
import pytest
from oracles.scenes import panorama
from scipy.ndimage import gaussian_filter

from panoloc_mcl.robot.camera import Panorama
from panoloc_mcl.robot.eigenspace.gradients import orientations
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.kernels.alignment import column_products, normal_equations
from panoloc_mcl.robot.settings.observation import RefinementSettings, VotesSettings
from panoloc_mcl.robot.synthesis import PoseRefiner, refinement
from panoloc_mcl.robot.synthesis.planes import planes_of
from panoloc_mcl.robot.synthesis.views import FloorRays, ViewSynthesizer

SETTINGS = VotesSettings()
TILT = np.radians(2.0)


def positive_definite(matrix: np.ndarray) -> bool:
    return bool(np.allclose(matrix, matrix.T) and np.linalg.eigvalsh(matrix).min() > 0.0)


def refined(world, walls: str, truth: np.ndarray, off: np.ndarray, leaning=(0.0, 0.0), **settings):
    """The measurement from a start that is off, and its errors: metres and degrees."""
    chosen = SETTINGS.model_copy(update={"refinement": RefinementSettings(**settings)})
    z, usable = orientations(world.room.panorama(world.geometry, truth, leaning), chosen)
    measured = PoseRefiner(getattr(world, walls), chosen).refine(z, usable, truth + off)
    far = float(np.hypot(*(measured.pose[:2] - truth[:2])))
    return measured, far, float(np.degrees(np.abs(angle_difference(measured.pose[2], truth[2]))))


def starts(count: int):
    """True poses between the references, and starts 10 cm and 2 degrees off."""
    rng = np.random.default_rng(3)
    for _ in range(count):
        direction = rng.uniform(0.0, 2.0 * np.pi)
        off = np.array([0.1 * np.cos(direction), 0.1 * np.sin(direction), np.radians(2.0) * rng.choice([-1.0, 1.0])])
        yield rng.uniform([0.0, 0.0, -np.pi], [2.0, 1.0, np.pi]), off


@pytest.mark.parametrize("walls", ["exact", "swept"])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (TILT, 0.0), (-0.6 * TILT, 0.8 * TILT)])
def test_poses_are_found_to_millimetres(fine, walls: str, tilt: tuple[float, float]) -> None:
    for truth, off in starts(5):
        measured, far, turned = refined(fine, walls, truth, off, tilt)
        assert far < 0.01
        assert turned < 0.2
        assert measured.tilt == pytest.approx(tilt, abs=np.radians(0.15))
        assert measured.agreement.cosine > 0.85
        assert positive_definite(measured.covariance)
        # As sharp as it is, but for a factor: neither metres nor nanometres.
        assert 1e-4 < np.sqrt(np.diag(measured.covariance)[:2]).max() < 0.02


def test_without_tilt_among_the_unknowns_a_level_camera_is_met_as_well(fine) -> None:
    truth, off = next(starts(1))
    measured, far, turned = refined(fine, "exact", truth, off, tilt=False)
    assert far < 0.01
    assert turned < 0.2
    assert not measured.tilt.any()
    _, tilted_far, _ = refined(fine, "exact", truth, off, (TILT, 0.0), tilt=False)
    assert tilted_far > far


@pytest.mark.parametrize("sources", [1, 2, 4, 8])
def test_any_number_of_sources_will_do(small, sources: int) -> None:
    truth, off = np.array([0.8, 0.6, 1.0]), np.array([0.08, -0.06, np.radians(2.0)])
    measured, far, turned = refined(small, "exact", truth, off, sources=sources)
    assert far < 0.02
    assert turned < 0.5
    assert positive_definite(measured.covariance)


def unsure(world, sds: np.ndarray, moved: np.ndarray) -> ViewSynthesizer:
    """The world's views, with one reference off by ``moved``, and poses of the references claimed to be so sure."""
    references = world.exact.references
    positions = references.positions.copy()
    positions[0] += moved
    return ViewSynthesizer(replace(references, positions=positions, sds=sds), world.exact.profiles, world.exact.camera_height_m)


def test_references_that_are_less_sure_of_their_poses_count_less(small) -> None:
    count = len(small.exact.references)
    sure = np.tile([0.002, np.radians(0.05)], (count, 1))
    doubtful = sure.copy()
    doubtful[0] = [0.2, np.radians(5.0)]
    moved = np.array([0.12, -0.1])
    truth = np.array([*(small.exact.references.positions[0] + [0.3, 0.25]), 0.4])
    z, usable = orientations(small.room.panorama(small.geometry, truth), SETTINGS)
    errors = []
    for sds in (sure, doubtful):
        measured = PoseRefiner(unsure(small, sds, moved), SETTINGS).refine(z, usable, truth)
        errors.append(float(np.hypot(*(measured.pose - truth)[:2])))
    assert errors[1] < 0.6 * errors[0]
    # Where all are alike nothing changes, to the last bit.
    one, other = (
        PoseRefiner(unsure(small, sds, 0.0 * moved), SETTINGS).refine(z, usable, truth).pose for sds in (sure, 30.0 * sure)
    )
    np.testing.assert_array_equal(one, other)


def test_what_is_claimed_of_an_answer_contains_what_the_map_claims_of_itself(small) -> None:
    count = len(small.exact.references)
    truth = np.array([*(small.exact.references.positions[0] + [0.3, 0.25]), 0.4])
    z, usable = orientations(small.room.panorama(small.geometry, truth), SETTINGS)
    sds = np.tile([0.03, np.radians(1.0)], (count, 1))
    measured = PoseRefiner(unsure(small, sds, np.zeros(2)), SETTINGS).refine(z, usable, truth)
    assert (np.sqrt(np.diag(measured.covariance)) >= [0.03, 0.03, np.radians(1.0)]).all()
    assert (np.linalg.eigvalsh(measured.covariance - measured.of_map) > 0.0).all()


def test_headings_come_out_within_the_range(small) -> None:
    for heading in (np.pi - 0.005, -np.pi + 0.005):
        for turn in (-0.03, 0.03):
            measured, far, _ = refined(small, "exact", np.array([0.5, 0.5, heading]), np.array([0.0, 0.0, turn]))
            assert -np.pi <= measured.pose[2] < np.pi
            assert far < 0.02


@pytest.mark.parametrize("sources", [1, 2])
def test_an_image_that_fits_exactly_still_errs(small, sources: int) -> None:
    chosen = SETTINGS.model_copy(update={"refinement": RefinementSettings(sources=sources)})
    z, usable = orientations(small.references.panorama(0), chosen)
    measured = PoseRefiner(small.exact, chosen).refine(z, usable, np.zeros(3))
    assert measured.pose == pytest.approx(np.zeros(3), abs=1e-3)
    assert measured.agreement.cosine > 0.95
    assert positive_definite(measured.covariance)
    assert np.isfinite(measured.relative_likelihood(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))).all()


def test_nothing_in_common_says_nothing(small) -> None:
    z, usable = orientations(small.references.panorama(0), SETTINGS)
    start = np.array([0.5, 0.5, 1.0])
    measured = PoseRefiner(small.exact, SETTINGS).refine(np.zeros_like(z), np.zeros_like(usable), start)
    assert measured.pose == pytest.approx(start)
    assert measured.agreement.cosine == 0.0
    assert np.linalg.eigvalsh(measured.covariance).min() > 100.0


def test_another_image_agrees_much_less(small) -> None:
    z, usable = orientations(panorama(np.random.default_rng(0).integers(20, 235, (36, 90))), SETTINGS)
    measured = PoseRefiner(small.exact, SETTINGS).refine(z, usable, np.array([0.5, 0.5, 0.0]))
    assert np.isfinite(measured.pose).all()
    assert measured.agreement.cosine < 0.5


@pytest.mark.parametrize("unknown", range(5))
def test_the_equations_know_what_a_small_step_changes(fine, unknown: int) -> None:
    """A view rendered a small step away: the equations name the step, and no other."""
    # Smooth features, whose central differences are their derivatives.
    smooth = SETTINGS.model_copy(update={"smoothing_px": 3.0})
    step = np.zeros(5)
    step[unknown] = 0.01
    truth = np.array([0.4, 0.45, 0.0])
    view, view_usable = orientations(fine.room.panorama(fine.geometry, truth), smooth)
    query, query_usable = orientations(fine.room.panorama(fine.geometry, truth + step[:3], step[3:]), smooth)
    rays = FloorRays.of(fine.geometry, fine.room.height_m)
    profile = fine.room.profile(truth[:2], 180)
    products = column_products(view, view_usable, query, query_usable, profile, rays.floor, rays.tangents, 1)
    normal, right, *_ = normal_equations(products, np.ones(len(profile), dtype=bool), rays.row_step)
    solved = np.linalg.solve(normal, right)
    assert solved[unknown] == pytest.approx(0.01, rel=0.25)
    assert np.abs(np.delete(solved, unknown)).max() < 0.0015


def test_of_several_starts_the_one_that_agrees_is_refined(fine) -> None:
    truth = np.array([0.9, 0.6, 0.4])
    z, usable = orientations(fine.room.panorama(fine.geometry, truth), SETTINGS)
    wrong = [np.array([1.8, 0.1, -2.0]), np.array([0.1, 0.9, 2.5])]
    refiner = PoseRefiner(fine.exact, SETTINGS)
    measured, agreements = refiner.refine_best(z, usable, [*wrong, truth + np.array([0.08, -0.05, 0.02])])
    assert np.hypot(*(measured.pose - truth)[:2]) < 0.01
    assert len(agreements) == 3
    assert int(np.argmax(agreements)) == 2


def test_a_start_that_suffices_is_the_last_that_is_tried(fine) -> None:
    truth = np.array([0.9, 0.6, 0.4])
    z, usable = orientations(fine.room.panorama(fine.geometry, truth), SETTINGS)
    measured, agreements = PoseRefiner(fine.exact, SETTINGS).refine_best(
        z, usable, [truth, truth + np.array([0.3, 0.0, 0.0])], 0.5
    )
    assert len(agreements) == 1
    assert np.hypot(*(measured.pose - truth)[:2]) < 0.01


def test_an_occluder_over_a_quarter_of_the_view_does_not_pull_the_pose(fine) -> None:
    """Somebody stands close: textured, so no mask hides it."""
    rng = np.random.default_rng(2)
    for truth, off in starts(3):
        image = fine.room.panorama(fine.geometry, truth)
        pixels = image.pixels.copy()
        pixels[:, 20:65] = rng.uniform(30.0, 220.0, (pixels.shape[0], 45)).astype(np.float32)
        z, usable = orientations(panorama(pixels), SETTINGS)
        measured = PoseRefiner(fine.exact, SETTINGS).refine(z, usable, truth + off)
        assert np.hypot(*(measured.pose - truth)[:2]) < 0.012
        for hidden in measured.agreement.sectors.reshape(3, -1) < 0.4:
            assert 2 <= hidden.sum() <= 9


@pytest.mark.slow
def test_poses_are_where_many_more_steps_would_lead_though_image_and_views_share_only_part(fine, monkeypatch) -> None:
    refiner, sought = PoseRefiner(fine.swept, SETTINGS), []
    for number, (truth, off) in enumerate(starts(8)):
        seen = fine.room.panorama(fine.geometry, truth).pixels
        # Such as light that has moved: the steps shrink by half or less.
        texture = gaussian_filter(np.random.default_rng(number).standard_normal(seen.shape), 2.0, mode=("reflect", "wrap"))
        sought.append(
            (*orientations(Panorama((seen + 20.0 * texture / texture.std()).astype(np.float32)), SETTINGS), truth + off)
        )
    found = [refiner.refine(*one).pose for one in sought]
    monkeypatch.setattr(refinement, "_SMALLEST_STEP_M", 1e-6)
    monkeypatch.setattr(refinement, "_SMALL", 1e-4)
    at_rest = [refiner.refine(*one).pose for one in sought]
    assert np.median(np.hypot(*(np.array(found) - at_rest).T[:2])) < 2e-4


def test_a_pose_that_does_not_come_to_rest_is_looked_for_around(fine, monkeypatch) -> None:
    refiner = PoseRefiner(fine.exact, SETTINGS)
    looked = []
    search = PoseRefiner._around

    def watched(self, *arguments):
        looked.append((arguments[2].copy(), search(self, *arguments)))
        return looked[-1][1]

    monkeypatch.setattr(PoseRefiner, "_around", watched)
    for truth, off in starts(3):
        z, usable = orientations(fine.room.panorama(fine.geometry, truth, (0.0, 0.0)), SETTINGS)
        # The search by itself, without a single step.
        step = refinement._steps(SETTINGS.refinement, z.shape[1])[1][-1]
        planes = {step.sigma: planes_of(z, usable, step.sigma)}
        found = search(refiner, planes, step, truth + off * [1.0, 1.0, 0.0], np.zeros(2))
        assert np.hypot(*(found[:2] - truth[:2])) < 0.03
        monkeypatch.setattr(refinement, "_SOON", 1)
        measured = refiner.refine(z, usable, truth + off)
        assert np.hypot(*(measured.pose[:2] - truth[:2])) < 0.01
    monkeypatch.undo()
    # An image of the map comes to rest by itself.
    refined(fine, "exact", *next(starts(1)))
    assert 1 <= len(looked) <= 3


def test_an_expected_pose_is_followed_to_what_a_search_finds(fine) -> None:
    refiner = PoseRefiner(fine.exact, SETTINGS)
    for truth, off in starts(4):
        z, usable = orientations(fine.room.panorama(fine.geometry, truth), SETTINGS)
        followed, found = refiner.follow(z, usable, truth + 0.4 * off), refiner.refine(z, usable, truth + off)
        assert np.hypot(*(followed.pose - truth)[:2]) < 0.01
        assert np.hypot(*(followed.pose - found.pose)[:2]) < 0.003
        assert np.linalg.eigvalsh(followed.covariance).min() > 0.0
