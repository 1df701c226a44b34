"""What tells a right best pose from a wrong one."""

import numpy as np
import pytest

from panoloc_mcl.robot.measurement import Agreement, PoseMeasurement
from panoloc_mcl.robot.observation.evidence import evidence, of_evidence, told_apart
from panoloc_mcl.robot.observation.field import VoteField
from panoloc_mcl.robot.observation.places import Places
from panoloc_mcl.robot.observation.regression import probabilities

PLACES = Places(np.array([[x, 0.0] for x in np.arange(0.0, 2.0, 0.25)]))


def test_evidence_is_finite_for_fields_of_any_kind() -> None:
    for votes in (np.zeros((6, len(PLACES))), np.ones((6, len(PLACES)))):
        field = VoteField(votes.astype(np.float32), 2.0 * np.pi * np.arange(6) / 6, PLACES, 0.1)
        assert np.isfinite(evidence(field)).all()
        nothing = PoseMeasurement(np.zeros(3), np.eye(3), np.zeros(2), Agreement(-1.0, np.full(24, np.nan), -1.0))
        assert np.isfinite(evidence(field.with_measurement(nothing))).all()


def test_weights_on_the_worst_third_relative_to_the_whole_are_weights_on_evidence() -> None:
    rng = np.random.default_rng(2)
    seen, weights = rng.normal(size=(50, 5)), rng.normal(size=(2, 6))
    assert probabilities(told_apart(seen), weights) == pytest.approx(probabilities(seen, of_evidence(weights)))
