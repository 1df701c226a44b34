"""The search, and which of the found values are taken over."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.robot.map.camera_search.adjustment import LAST_STEPS, MORE_STEPS, Adjustment, Estimated, adjust
from panoloc_mcl.robot.map.camera_search.blocks import Equations
from panoloc_mcl.robot.map.camera_search.parameters import Parameter
from panoloc_mcl.tools.calibration.parameters import parameters_by_references

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)


def outcome(values, covariance, start=(0.0, 0.0), inverse=None) -> Adjustment:
    """Of a search that found these values."""
    parameters = [
        Parameter(name, "px", at, 1.0, 10.0, 0.0, lambda camera, _: camera) for name, at in zip("ab", start, strict=True)
    ]
    estimates = tuple(
        Estimated(one, value, float(np.sqrt(variance)) if variance else np.inf)
        for one, value, variance in zip(parameters, values, np.diag(covariance), strict=True)
    )
    covariance = np.asarray(covariance, dtype=np.float64)
    return Adjustment(CAMERA, estimates, 0.5, 0.9, 20, covariance, covariance if inverse is None else inverse)


def test_what_looks_like_another_unknown_is_told_once_that_is_as_described() -> None:
    """Least squares with the second value held at its description is the oracle."""
    rng = np.random.default_rng(3)
    design = rng.normal(size=(40, 2)) @ np.array([[1.0, 0.95], [0.0, 0.3]])
    seen = design @ [3.0, 0.0] + 0.5 * rng.normal(size=40)
    normal = design.T @ design
    found = outcome(np.linalg.solve(normal, design.T @ seen), 0.25 * np.linalg.inv(normal))
    told = found.told(2.0)
    assert [one.parameter.name for one in told] == ["a"]
    assert told[0].value == pytest.approx(design[:, 0] @ seen / (design[:, 0] @ design[:, 0]))
    assert told[0].sd == pytest.approx(0.5 / np.sqrt(design[:, 0] @ design[:, 0]))


def test_what_the_search_errs_by_does_not_hide_that_two_unknowns_look_alike() -> None:
    covariance = np.array([[1.0, 0.95], [0.95, 1.0]])
    one = outcome([8.0, 1.5], covariance)
    wider = tuple(Estimated(each.parameter, each.value, 2.0) for each in one.estimates)
    (told,) = Adjustment(CAMERA, wider, 0.5, 0.9, 20, covariance, covariance).told(2.0)
    assert told.value == pytest.approx(8.0 - 0.95 * 1.5)
    assert told.sd == pytest.approx(np.sqrt(1.0 - 0.95**2 + 3.0))


def test_what_only_scatters_together_is_not_told_anew() -> None:
    """As a mount's place and the elevations, of 14 images: 2 sd of one are not worth half a sd of the other for each."""
    one = outcome([8.0, 1.5], np.array([[1.0, 0.5], [0.5, 1.0]]), inverse=np.eye(2))
    (told,) = one.told(2.0)
    assert (told.value, told.sd) == (8.0, 1.0)


def test_values_within_chance_and_those_that_nobody_can_tell_stay_as_described() -> None:
    assert outcome([1.5, 0.0], np.diag([1.0, 0.0])).told(2.0) == ()
    both = outcome([5.0, 15.0], np.diag([1.0, 4.0]), start=(0.0, 5.0)).told(2.0)
    assert [(one.parameter.name, one.value, one.sd) for one in both] == [("a", 5.0, 1.0), ("b", 15.0, 2.0)]


@dataclass
class Parabolas:
    """Images that each want a mount's yaw of their own, and give so much of what a step really changes as derivative."""

    wanted: np.ndarray
    share: float = 1.0
    agreement: float = 0.8
    values: list[float] = field(default_factory=list)

    def equations(self, camera, varied, steps, sigma_px) -> list[Equations]:
        assert len(varied) == len(steps) == 1
        yaw = camera.mounting.yaw_deg
        self.values.append(yaw)
        normal = np.array([[300.0]])
        return [Equations(normal, normal[0] * (one - yaw) / self.share, self.agreement, 1.0) for one in self.wanted]

    def moved(self, step) -> None:
        """Nothing of its own."""


def yaw_found(scene: Parabolas) -> Estimated:
    parameters = [one for one in parameters_by_references(CAMERA, placed=True) if one.name == "yaw"]
    (found,) = adjust(CAMERA, parameters, scene, schedule=LAST_STEPS, more=MORE_STEPS).estimates
    return found


def test_a_search_that_goes_too_far_does_not_go_to_and_fro() -> None:
    """Steps that are too long by 1.4 already must not be lengthened for the agreement besides: 1.4 / 0.8^2 is beyond 2."""
    scene = Parabolas(5.0 + 0.1 * np.random.default_rng(0).normal(size=14), share=1.0 / 1.4)
    assert yaw_found(scene).value == pytest.approx(5.0, abs=0.1)
    assert len(scene.values) < len(LAST_STEPS) + MORE_STEPS


def test_images_that_contradict_the_rest_count_little() -> None:
    """As references in the goals of `hall`: five of 42 were off by a quarter to half a degree, and the rest agreed to a tenth."""
    rng = np.random.default_rng(1)
    errors = 0.07 * rng.normal(size=42)
    errors[:5] = (0.4, 0.5, 0.6, 0.5, 0.7)
    found = yaw_found(Parabolas(20.0 + errors))
    assert abs(found.value - 20.0) < 0.6 * errors.mean()
    assert abs(found.value - 20.0) < 0.04


def test_images_that_agree_all_count_alike() -> None:
    errors = 0.1 * np.random.default_rng(2).normal(size=400)
    found = yaw_found(Parabolas(errors))
    accuracy = found.parameter.accuracy
    assert found.value == pytest.approx(errors.mean(), abs=0.1 / np.sqrt(400))
    assert np.sqrt(found.sd**2 - accuracy**2) == pytest.approx(0.1 / np.sqrt(400), rel=0.2)


def test_what_the_search_cannot_tell_anyway_is_left_alone_from_the_start() -> None:
    scene = Parabolas(5.0 + 0.1 * np.random.default_rng(0).normal(size=14))
    (parameter,) = (one for one in parameters_by_references(CAMERA, placed=True) if one.name == "yaw")
    hidden = replace(parameter, accuracy=parameter.largest)
    (found,) = adjust(CAMERA, [hidden], scene, schedule=LAST_STEPS, more=MORE_STEPS).estimates
    assert not found.observable
    assert set(scene.values) == {0.0}
