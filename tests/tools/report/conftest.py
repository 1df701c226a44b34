from datetime import datetime

import numpy as np
import pytest

from panoloc_mcl.tools.evaluation import SequenceRecord, evaluate
from panoloc_mcl.tools.report import ResultsWriter

STARTED = datetime(2024, 5, 6, 7, 8, 9)
PLACES = np.array([[0.0, 0.0], [1.0, 0.1], [1 / 3, 2.0]])


@pytest.fixture
def started():
    return STARTED


@pytest.fixture
def places():
    return PLACES


@pytest.fixture
def make_record():
    """Make records with uneven numbers, so that rounding would show."""

    def make(name="noon_00", run=0, n=25, with_truth=True, kidnapped_at=None):
        rng = np.random.default_rng([run, n])
        truth = np.column_stack([rng.uniform(0, 2, (n, 2)), np.linspace(-4, 4, n)])
        status = ["searching", "ambiguous", *["converged"] * (n - 2)]
        return SequenceRecord(
            name=name,
            run=run,
            times=1.7e9 + np.cumsum(rng.uniform(0.1, 0.9, n)),
            poses=truth + rng.normal(0, 0.1, (n, 3)),
            truth=truth if with_truth else None,
            status=tuple(status),
            best_place=rng.integers(-1, 3, n),
            step_ms=rng.gamma(5.0, 2.0, n),
            kidnapped=np.arange(n) == (-1 if kidnapped_at is None else kidnapped_at),
        )

    return make


@pytest.fixture
def steps():
    def make(record):
        return [{"message": "", "particles": 500, "n_eff": 250.5, "ms_score": 1.25, "ms_filter": 0.5} for _ in record.times]

    return make


@pytest.fixture
def run_info():
    return {"name": "hall | global", "dataset": "hall", "mode": "monte_carlo", "model": "votes", "seed": 0, "runs": 2}


@pytest.fixture
def unfinished(tmp_path, make_record, steps, run_info):
    """A writer with everything written but the end, and its records."""
    writer = ResultsWriter(tmp_path / "results", "hall", STARTED)
    writer.write_config({"dataset": "hall", "seed": 0})
    writer.write_run_info(run_info)
    writer.write_places(["a.png", "b,1.png", ""], PLACES)
    runs = [make_record(), make_record(run=1, kidnapped_at=12), make_record("evening_00", with_truth=False)]
    return writer, [writer.write_run(record, steps(record)) for record in runs]


@pytest.fixture
def finished(unfinished):
    """A whole results folder and its metrics."""
    writer, records = unfinished
    metrics = evaluate(records, PLACES)
    return writer.finish(metrics, summary="# summary\n", report="<!DOCTYPE html>\n"), metrics
