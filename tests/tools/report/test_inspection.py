import numpy as np
import pytest

from panoloc_mcl.robot.observation import Places
from panoloc_mcl.tools.report.inspection import covered_m2


def test_the_ground_covered_is_that_around_the_places() -> None:
    single = Places(np.zeros((1, 2)))
    # A disc of one spacing, which is 1 m for a single place.
    assert covered_m2(single) == pytest.approx(np.pi, rel=0.02)
