import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.laboratory.comparison import cell as cells
from panoloc_mcl.laboratory.comparison.cell import attempt, forget_data, make_job
from panoloc_mcl.laboratory.comparison.runs import Failure, Runs, read_runs, write_runs
from panoloc_mcl.laboratory.corruptions import corrupt
from panoloc_mcl.robot.errors import ResultsError
from panoloc_mcl.tools.datasets import read_dataset
from panoloc_mcl.tools.runs.pipeline import run


def jobs(plan):
    return [make_job(cell, plan.datasets[cell.config.dataset]) for cell in plan.cells]


def same(a, b):
    np.testing.assert_array_equal(a.places, b.places)
    assert len(a.records) == len(b.records)
    for one, other in zip(a.records, b.records, strict=True):
        assert (one.name, one.status) == (other.name, other.status)
        for name in ("times", "poses", "truth", "best_place", "kidnapped"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_clean_cell_gives_what_a_run_gives(plan_of, tmp_path):
    (job, *_) = jobs(plan_of(frames=None))
    found = attempt(job)
    config = job.cell.config.model_copy(update={"out": tmp_path})
    folder = run(config).folder
    written = np.loadtxt(folder / "noon_00" / "run_0" / "trajectory.tum")
    np.testing.assert_allclose(found.records[0].poses[:, :2], written[:, 1:3], atol=1e-9)
    same(found, attempt(job))


def test_the_key_is_that_of_everything_that_counts(plan_of):
    base = {job.key for job in jobs(plan_of())}
    assert len(base) == 4
    assert base == {job.key for job in jobs(plan_of(name="other", base={**plan_base(), "name": "x"}))}
    for change in (
        {"corruptions": ["bars:0.1"]},
        {"references": ["fourth"]},
        {"frames": 4},
        {"seeds": [7]},
        {"modes": ["kalman_orientation"]},
        {"variants": {"x": {"localizer.monte_carlo.particles": 77}}},
        {"variants": {"x": {"map.mend": False}}},
        {"every": 2},
    ):
        assert not base & {job.key for job in jobs(plan_of(**change))}


def plan_base():
    return {"observation": {"votes": {"virtual_places": {"enabled": False}}}}


def test_the_key_goes_with_the_data_and_not_with_their_place(plan_of, small_room, tmp_path):
    copy = shutil.copytree(small_room.path, tmp_path / "elsewhere")
    before = [job.key for job in jobs(plan_of())]
    assert [job.key for job in jobs(plan_of(datasets=[str(copy)]))] == before
    fourth, fifth = read_dataset(copy).sequences["noon_00"].files[3:5]
    assert isinstance(fourth, Path)
    assert isinstance(fifth, Path)
    shutil.copy(fifth, fourth)
    assert not set(before) & {job.key for job in jobs(plan_of(datasets=[str(copy)]))}


@pytest.mark.slow
def test_all_models_see_the_same_corrupted_images(plan_of, monkeypatch):
    seen: dict[str, list[np.ndarray]] = {}

    class Spy:
        def __init__(self, model):
            self._model = model

        def __getattr__(self, name):
            return getattr(self._model, name)

        def observe(self, panorama, headings=None):
            seen.setdefault(self._model.name, []).append(panorama.pixels)
            return self._model.observe(panorama, headings)

    real = cells._map

    def spied(job, dataset):
        built, model, *more = real(job, dataset)
        return built, Spy(model), *more

    monkeypatch.setattr(cells, "_map", spied)
    for job in jobs(plan_of(corruptions=["random_pixels:0.5"], seeds=1)):
        assert isinstance(attempt(job), Runs)
    np.testing.assert_array_equal(seen["votes"], seen["orientation_correlation"])
    assert len({image.tobytes() for image in seen["votes"]}) == 3


def test_frames_are_dropped_and_cut_off(plan_of):
    (job,) = jobs(plan_of(corruptions=["drop_frames:0.5"], frames=8, observations=["votes"], seeds=1))
    assert len(attempt(job).records[0]) == 4
    (job,) = jobs(plan_of(corruptions=["drop_frames:1"], observations=["votes"], seeds=1))
    assert "no frame is left of 3" in attempt(job).text


@pytest.mark.slow
def test_an_imperfect_data_set_is_written_once_and_run_over(plan_of, monkeypatch):
    (clean, job, again) = jobs(
        plan_of(corruptions=["clean", "body:strong", "body:strong+told"], observations=["votes"], seeds=1)
    )
    assert len({clean.key, job.key, again.key}) == 3
    written = []

    def counted(*words):
        written.append(words)
        return corrupt(*words)

    monkeypatch.setattr(cells, "corrupt", counted)
    monkeypatch.setattr(cells, "_MAPS", {})
    first, second = attempt(job), attempt(job)
    assert isinstance(first, Runs)
    same(first, second)
    assert len(written) == 1
    assert len(first.records[0]) == 3
    (answers,) = first.answers
    assert answers.poses.shape == (3, 3)
    assert first.records[0].covariances.shape == (3, 3, 3)
    other = attempt(clean)
    assert not np.array_equal(other.records[0].poses, first.records[0].poses)


@pytest.mark.slow
def test_single_images_tell_of_the_base_too(plan_of):
    """A camera that is mounted off the base, and told to be, changes nothing that is said of the base."""
    (clean, job) = jobs(plan_of(corruptions=["clean", "mount:strong+told"], observations=["votes"], seeds=1))
    (before,), (after,) = attempt(clean).answers, attempt(job).answers
    shifts = np.hypot(*(after.poses - before.poses)[:, :2].T)
    # Both are told in the frame of their own base, 15 cm apart, along the heading.
    np.testing.assert_allclose(shifts, 0.15, atol=0.02)
    (record,), (other,) = attempt(clean).records, attempt(job).records
    assert record.truth is not None
    assert other.truth is not None
    errors = [
        np.hypot(*(poses - truth)[:, :2].T) for poses, truth in ((record.poses, record.truth), (other.poses, other.truth))
    ]
    np.testing.assert_allclose(errors[0], errors[1], atol=0.03)


def test_a_kept_cell_is_read_as_it_was(plan_of, tmp_path):
    (job, *_) = jobs(plan_of())
    runs = attempt(job)
    assert isinstance(runs, Runs)
    write_runs(tmp_path / "cell.npz", job.key, job.cell.axes, runs)
    same(read_runs(tmp_path / "cell.npz", job.key), runs)
    with pytest.raises(ResultsError, match="run again"):
        read_runs(tmp_path / "cell.npz", "another key")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_cell_is_refused(plan_of, tmp_path, share):
    (job, *_) = jobs(plan_of())
    runs = attempt(job)
    assert isinstance(runs, Runs)
    write_runs(tmp_path / "cell.npz", job.key, job.cell.axes, runs)
    whole = (tmp_path / "cell.npz").read_bytes()
    (tmp_path / "cell.npz").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ResultsError, match="run again"):
        read_runs(tmp_path / "cell.npz", job.key)


@pytest.mark.slow
def test_what_goes_wrong_is_one_line(plan_of, monkeypatch):
    (job,) = jobs(plan_of(observations={"paper": {"paper": {"components": 50}}}, seeds=1))
    failure = attempt(job)
    assert isinstance(failure, Failure)
    assert "components" in failure.text
    assert not failure.unfit
    monkeypatch.setattr(cells, "run_cell", lambda job: 1 / 0)
    assert attempt(job).text == "ZeroDivisionError: division by zero"


def test_a_worker_without_the_data_says_so(plan_of, small_room, tmp_path):
    copy = shutil.copytree(small_room.path, tmp_path / "room")
    (job, *_) = jobs(plan_of(datasets=[str(copy)]))
    forget_data()
    other = attempt(replace(job, data="of another data set"))
    assert other.unfit
    assert "holds other data" in other.text
    shutil.rmtree(copy)
    forget_data()
    gone = attempt(job)
    assert gone.unfit
    assert "neither a folder" in gone.text
