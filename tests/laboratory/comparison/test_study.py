import csv
from pathlib import Path

import pytest

from panoloc_mcl.laboratory.comparison.cell import attempt
from panoloc_mcl.laboratory.comparison.study import compare, plan_of_sources
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.settings.validation import dump_yaml
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.runs.pipeline import SilentMonitor, run


class Counting:
    """An engine that remembers what it ran, and is interrupted after so many cells."""

    def __init__(self, until=10**6):
        self.ran, self._until = [], until

    def run(self, jobs):
        for job in jobs:
            if len(self.ran) == self._until:
                raise KeyboardInterrupt
            self.ran.append(job.key)
            yield job, attempt(job)


class Listening(SilentMonitor):
    def __init__(self):
        self.notices = []

    def notice(self, text):
        self.notices.append(text)


def rows_in(folder):
    with (Path(folder) / "table.csv").open() as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
def test_finished_cells_are_not_run_again(plan_of, tmp_path):
    first = compare(plan_of(), tmp_path, Counting(), plots=False)
    assert first.ran == 4
    table = (tmp_path / "small" / "table.csv").read_bytes()
    engine = Counting()
    again = compare(plan_of(), tmp_path, engine, plots=False)
    assert engine.ran == []
    assert again.ran == 0
    assert (tmp_path / "small" / "table.csv").read_bytes() == table
    engine = Counting()
    compare(plan_of(seeds=3), tmp_path, engine, plots=False)
    assert len(engine.ran) == 2


def test_interrupted_and_started_again_it_goes_on(plan_of, tmp_path):
    whole = compare(plan_of(), tmp_path / "whole", Counting(), plots=False)
    interrupted = Counting(until=2)
    with pytest.raises(KeyboardInterrupt):
        compare(plan_of(), tmp_path / "parts", interrupted, plots=False)
    assert not (tmp_path / "parts" / "small" / "summary.md").exists()
    engine = Counting()
    compare(plan_of(), tmp_path / "parts", engine, plots=False)
    assert len(engine.ran) == 2
    assert not set(engine.ran) & set(interrupted.ran)
    for name in ("table.csv", "table.parquet", "differences.csv"):
        assert (tmp_path / "parts" / "small" / name).read_bytes() == (whole.folder / name).read_bytes()


def test_a_truncated_cell_is_run_again(plan_of, tmp_path):
    compare(plan_of(), tmp_path, Counting(), plots=False)
    table = (tmp_path / "small" / "table.csv").read_bytes()
    damaged = sorted((tmp_path / "small" / "cells").iterdir())[1]
    damaged.write_bytes(damaged.read_bytes()[:-100])
    engine, monitor = Counting(), Listening()
    compare(plan_of(), tmp_path, engine, monitor, plots=False)
    assert engine.ran == [damaged.stem]
    assert "run again" in monitor.notices[0]
    assert (tmp_path / "small" / "table.csv").read_bytes() == table


@pytest.mark.slow
def test_a_failing_cell_is_one_row_and_the_rest_goes_on(plan_of, tmp_path):
    plan = plan_of(observations={"votes": {}, "paper": {"paper": {"components": 50}}}, seeds=1)
    study = compare(plan, tmp_path, plots=False)
    good, bad = rows_in(study.folder)
    assert (good["observation"], good["error"]) == ("votes", "")
    assert "components" in bad["error"]
    assert bad["sequence"] == bad["frames"] == ""
    assert "## Failed cells" in study.summary
    # Perhaps it was the machine: it gets another chance.
    assert compare(plan, tmp_path, plots=False).ran == 1


def test_a_table_in_two_formats_and_a_summary(plan_of, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    study = compare(plan_of(), tmp_path)
    rows = rows_in(study.folder)
    assert len(rows) == 4
    table = parquet.read_table(study.folder / "table.parquet").to_pylist()
    for text, typed in zip(rows, table, strict=True):
        assert text == {name: "" if value is None else str(value) for name, value in typed.items()}
    assert rows[0]["frames"] == "3"
    assert float(rows[0]["position_median_m"]) < 1.0
    for part in ("## Ranking", "## Figures", "## Paired differences to votes", "## Cost", "(errors.png)", "(cost.png)"):
        assert part in study.summary
    for name in ("errors.png", "convergence.png", "cost.png"):
        assert (study.folder / name).read_bytes().startswith(b"\x89PNG")
    assert not (study.folder / "severity.png").exists()
    with (study.folder / "cost.csv").open() as stream:
        assert [row["images"] for row in csv.DictReader(stream)] == ["6", "6"]


def test_severity_is_drawn_where_there_are_several(plan_of, tmp_path):
    study = compare(plan_of(corruptions=["clean", "bars:0.3", "bars:0.6"], seeds=1), tmp_path)
    assert (study.folder / "severity.png").read_bytes().startswith(b"\x89PNG")


def test_a_baseline_that_is_no_method(plan_of, tmp_path):
    with pytest.raises(ConfigError, match=r"baseline = 'vote': is no method .* there are: votes; orientation_correlation"):
        compare(plan_of(baseline="vote", seeds=1), tmp_path, plots=False)


def test_runs_and_results_folders_side_by_side(small_room, tmp_path):
    settings = {"dataset": str(small_room.path), "observation": {"votes": {"virtual_places": {"enabled": False}}}}
    (tmp_path / "many.yaml").write_text(dump_yaml({"name": "many", **settings}))
    few = {**settings, "localizer": {"monte_carlo": {"particles": 200}}}
    (tmp_path / "few.yaml").write_text(dump_yaml({"name": "few", **few}))
    config = config_from_mapping({"name": "before", "out": str(tmp_path / "results"), **settings})
    folder = run(config).folder
    plan = plan_of_sources([tmp_path / "many.yaml", tmp_path / "few.yaml", folder])
    study = compare(plan, tmp_path / "out", plots=False)
    rows = rows_in(study.folder)
    assert [row["variant"] for row in rows] == ["many", "few", folder.name]
    # The same configuration, once as a cell and once as a run.
    assert float(rows[0]["position_median_m"]) == pytest.approx(float(rows[2]["position_median_m"]), abs=1e-8)
    of_run = [d for d in study.differences if d.method == folder.name and d.figure == "position median"]
    assert of_run[0].mean == pytest.approx(0.0, abs=1e-5)


def test_values_beat_the_file(data, tmp_path):
    (tmp_path / "m.yaml").write_text(dump_yaml(data))
    plan = plan_of_sources([tmp_path / "m.yaml"], ["seeds=1", "observations=[votes]"])
    assert len(plan.cells) == 1
