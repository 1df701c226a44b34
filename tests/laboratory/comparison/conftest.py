import numpy as np
import pytest

from panoloc_mcl.laboratory.comparison.matrix import matrix_from_mapping
from panoloc_mcl.laboratory.comparison.runs import Failure, Runs
from panoloc_mcl.laboratory.comparison.study import plan_of_matrix
from panoloc_mcl.laboratory.comparison.summaries.tables import Entry
from panoloc_mcl.robot.files import CACHE_VARIABLE
from panoloc_mcl.tools.evaluation import SequenceRecord


@pytest.fixture(scope="session")
def comparisons_cache(tmp_path_factory):
    return tmp_path_factory.mktemp("comparisons_cache")


@pytest.fixture(autouse=True)
def _own_cache(comparisons_cache, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(comparisons_cache))


@pytest.fixture
def data(small_room):
    """A matrix of four cells as plain data."""
    return {
        "format": "panoloc-comparison/1",
        "name": "small",
        "datasets": [str(small_room.path)],
        "frames": 3,
        "base": {"observation": {"votes": {"virtual_places": {"enabled": False}}}},
        "observations": ["votes", "orientation_correlation"],
        "seeds": 2,
    }


@pytest.fixture
def plan_of(data):
    """The plan of that matrix with changes."""

    def plan(**changes):
        return plan_of_matrix(matrix_from_mapping({**data, **changes}))

    return plan


def a_record(name="noon_00", error_m=0.1, converged_from=0, frames=5, seed=0):
    rng = np.random.default_rng(seed)
    truth = np.column_stack([np.arange(frames) * 0.1, np.zeros(frames), np.zeros(frames)])
    poses = truth + np.array([error_m, 0.0, 0.01]) + rng.normal(0.0, 0.001, (frames, 3))
    status = tuple("converged" if index >= converged_from else "searching" for index in range(frames))
    return SequenceRecord(
        name=name,
        run=0,
        times=np.arange(frames, dtype=float),
        poses=poses,
        truth=truth,
        status=status,
        best_place=np.zeros(frames, dtype=np.int64),
        step_ms=np.full(frames, 10.0),
        kidnapped=np.zeros(frames, dtype=bool),
    )


@pytest.fixture
def entry():
    """An entry of a comparison made of one record, or of a failure."""

    def make(method="votes", light="noon", corruption="clean", seed=0, failure=None, **record):
        result = Failure(failure) if failure else Runs((a_record(f"{light}_00", seed=seed, **record),), np.zeros((1, 2)))
        return Entry(
            {"dataset": "room", "light": light, "corruption": corruption},
            {"references": "all", "observation": method, "mode": "monte_carlo", "variant": "default"},
            seed,
            result,
        )

    return make
