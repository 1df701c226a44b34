"""Which of the found values are taken over."""

import numpy as np
import pytest

from panoloc_mcl.robot.camera import PanoramaCamera
from panoloc_mcl.tools.calibration.adjustment import Adjustment, Estimated
from panoloc_mcl.tools.calibration.parameters import Parameter

CAMERA = PanoramaCamera(elevation_deg=(-50.0, 25.0), height_m=0.6)


def outcome(values, covariance, start=(0.0, 0.0)) -> Adjustment:
    """Of a search that found these values."""
    parameters = [
        Parameter(name, "px", at, 1.0, 10.0, 0.0, lambda camera, _: camera) for name, at in zip("ab", start, strict=True)
    ]
    estimates = tuple(
        Estimated(one, value, float(np.sqrt(variance)) if variance else np.inf)
        for one, value, variance in zip(parameters, values, np.diag(covariance), strict=True)
    )
    return Adjustment(CAMERA, estimates, 0.5, 0.9, 20, np.asarray(covariance, dtype=np.float64))


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
    (told,) = Adjustment(CAMERA, wider, 0.5, 0.9, 20, covariance).told(2.0)
    assert told.value == pytest.approx(8.0 - 0.95 * 1.5)
    assert told.sd == pytest.approx(np.sqrt(1.0 - 0.95**2 + 3.0))


def test_values_within_chance_and_those_that_nobody_can_tell_stay_as_described() -> None:
    assert outcome([1.5, 0.0], np.diag([1.0, 0.0])).told(2.0) == ()
    both = outcome([5.0, 15.0], np.diag([1.0, 4.0]), start=(0.0, 5.0)).told(2.0)
    assert [(one.parameter.name, one.value, one.sd) for one in both] == [("a", 5.0, 1.0), ("b", 15.0, 2.0)]
