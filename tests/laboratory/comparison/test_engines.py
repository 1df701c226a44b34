import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time

import pytest

from panoloc_mcl.laboratory.comparison.cell import make_job
from panoloc_mcl.laboratory.comparison.engines import EngineError, InProcess, open_engine
from panoloc_mcl.laboratory.comparison.study import compare

TABLES = ("table.csv", "table.parquet", "differences.csv")


def tables(study):
    return {name: (study.folder / name).read_bytes() for name in TABLES if (study.folder / name).exists()}


@pytest.fixture
def fresh_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def scheduler(fresh_port, tmp_path):
    """A scheduler and two workers, started by hand: its address, the workers' processes and its own."""
    pytest.importorskip("distributed")
    address = f"tcp://127.0.0.1:{fresh_port}"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    started: list[subprocess.Popen] = []

    def start(*words):
        log = (tmp_path / f"dask_{len(started)}.log").open("w")
        command = [sys.executable, "-m", "dask", *map(str, words)]
        # A folder of its own: paths of data sets must hold from anywhere.
        folder = tmp_path / f"dask_{len(started)}"
        folder.mkdir()
        started.append(subprocess.Popen(command, env=environment, cwd=folder, stdout=log, stderr=log, start_new_session=True))
        return started[-1]

    itself = start("scheduler", "--host", "127.0.0.1", "--port", fresh_port, "--no-dashboard", "--no-show")
    workers = [start("worker", address, "--nthreads", 1, "--no-dashboard", "--name", f"w{i}", "--no-nanny") for i in range(2)]
    yield address, workers, itself
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
    for process in started:
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)


def test_without_being_asked_cells_run_here():
    with open_engine() as engine:
        assert isinstance(engine, InProcess)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"workers": 0}, "--workers 0: must be from 1 to 1024"),
        ({"workers": 2, "scheduler": "tcp://127.0.0.1:1"}, "give one of the two"),
    ],
)
def test_engines_that_there_are_not(asked, said):
    with pytest.raises(EngineError, match=re.escape(said)) as error, open_engine(**asked):
        pass
    assert len(error.value.faults) == 1


def test_without_dask_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(EngineError, match=r"panoloc-mcl\[distributed\]"), open_engine(workers=2):
        pass


@pytest.mark.slow
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:{port}", "nonsense://x", "no such host:99999"])
def test_a_scheduler_out_of_reach_is_one_line(address, fresh_port, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("panoloc_mcl.laboratory.comparison.engines._CONNECT_S", 2)
    address = address.format(port=fresh_port)
    with pytest.raises(EngineError, match="cannot be reached") as error, open_engine(scheduler=address):
        pass
    assert error.value.faults[0].startswith(f"--scheduler {address}: ")
    assert len(error.value.faults) == 1


@pytest.mark.slow
def test_local_workers_give_the_same_bytes(plan_of, tmp_path):
    pytest.importorskip("distributed")
    plan = plan_of(corruptions=["clean", "bars:0.4"])
    here = compare(plan, tmp_path / "here", plots=False)
    with open_engine(workers=2) as engine:
        there = compare(plan, tmp_path / "there", engine, plots=False)
    assert there.ran == 8
    assert tables(there) == tables(here)


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_a_retry_and_changes_nothing(plan_of, tmp_path, scheduler):
    address, workers, _ = scheduler
    plan = plan_of(corruptions=["clean", "bars:0.4", "random_pixels:0.2"], seeds=4)
    here = compare(plan, tmp_path / "here", plots=False)
    with open_engine(scheduler=address) as engine:
        wait_for_workers(engine, 2)
        killed = Killing(engine, workers[0], after=4)
        there = compare(plan, tmp_path / "there", killed, plots=False)
    assert workers[0].wait(10) == -signal.SIGKILL
    assert there.ran == 24
    assert tables(there) == tables(here)


@pytest.mark.slow
def test_a_cluster_without_workers_or_data_says_so(plan_of, small_room, tmp_path, scheduler):
    address, workers, _ = scheduler
    copy = shutil.copytree(small_room.path, tmp_path / "room")
    plan = plan_of(datasets=[str(copy)], seeds=1)
    jobs = [make_job(cell, plan.datasets[cell.config.dataset]) for cell in plan.cells]
    shutil.rmtree(copy)
    with open_engine(scheduler=address) as engine:
        wait_for_workers(engine, 2)
        failures = [result for _, result in engine.run(jobs)]
        assert all(failure.unfit and "neither a folder" in failure.text for failure in failures)
        for worker in workers:
            # Not SIGTERM: a worker of Dask that closes by itself now and then takes longer than a test may wait.
            os.killpg(worker.pid, signal.SIGKILL)
            worker.wait(20)
        wait_for_workers(engine, 0)
        with pytest.raises(EngineError, match=r"has no workers; start one with: dask worker tcp://"):
            list(engine.run([]))


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_one_line_and_finished_cells_are_kept(plan_of, tmp_path, scheduler, capfd):
    address, _, itself = scheduler
    plan = plan_of(seeds=6)
    with open_engine(scheduler=address) as engine:
        wait_for_workers(engine, 2)
        with pytest.raises(EngineError, match="went away; start it") as error:
            compare(plan, tmp_path, Killing(engine, itself, after=3), plots=False)
    assert len(error.value.faults) == 1
    assert capfd.readouterr().err == ""
    kept = len(list((tmp_path / "small" / "cells").iterdir()))
    assert kept >= 2
    assert compare(plan, tmp_path, plots=False).ran == 12 - kept


def wait_for_workers(engine, count):
    until = time.monotonic() + 60
    while len(engine._client.scheduler_info(n_workers=-1)["workers"]) != count:
        assert time.monotonic() < until, "workers did not come"
        time.sleep(0.1)


class Killing:
    """An engine that loses a process midway."""

    def __init__(self, engine, process, after):
        self._engine, self._process, self._after = engine, process, after

    def run(self, jobs):
        for count, found in enumerate(self._engine.run(jobs), start=1):
            if count == self._after:
                os.killpg(self._process.pid, signal.SIGKILL)
            yield found
