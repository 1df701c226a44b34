from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot.errors import OutputError, ResultsError
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.report import FrameRecorder
from panoloc_mcl.tools.report.pages.page import grid_of, run_data
from panoloc_mcl.tools.report.results.recording import Recording, thinned
from panoloc_mcl.tools.report.sinks import NullSink, Scene, Sinks
from panoloc_mcl.tools.runs.map_cache import cached_map
from panoloc_mcl.tools.runs.pipeline import SilentMonitor, localize, make_tasks


class Diary(NullSink):
    """Writes down what it is shown."""

    def __init__(self):
        self.calls = []

    def open(self, scene):
        self.calls.append("open")

    def begin(self, departure):
        self.calls.append("begin")

    def take(self, frame):
        self.calls.append(frame.row)

    def end(self, record):
        self.calls.append("end")

    def close(self):
        self.calls.append("close")


@pytest.fixture(scope="module")
def observed(small_room, tmp_path_factory):
    """A short run over the small room: its record, what was recorded, what a diary says."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PANOLOC_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        plain = {"votes": {"virtual_places": {"enabled": False}}}
        config = config_from_mapping({"dataset": str(small_room.path), "observation": plain})
        panorama_map = cached_map(small_room, config.observation, 0, SilentMonitor().progress)
    model = panorama_map.observation_model(config.observation)
    task = make_tasks(small_room, config)[0]
    folder = tmp_path_factory.mktemp("run")
    recorder, diary = FrameRecorder(folder), Diary()
    sink = Sinks([recorder, diary])
    sink.open(Scene(panorama_map.name, panorama_map.references, model.places, (len(task.drive),)))
    record, steps, _ = localize(task, 0, panorama_map, model, config, sink)
    sink.close()
    return record, steps, recorder.recording, diary.calls, folder, (task, panorama_map, model, config)


def test_a_sink_is_shown_everything_in_order(observed):
    record, *_, calls, _, _ = observed
    assert calls == ["open", "begin", *range(len(record)), "end", "close"]


def test_watching_changes_nothing(observed):
    record, *_, (task, panorama_map, model, config) = observed
    unwatched, _, _ = localize(task, 0, panorama_map, model, config)
    assert np.array_equal(unwatched.poses, record.poses)
    assert unwatched.status == record.status


def test_a_recording_is_read_back_as_it_was(observed):
    record, _, recording, _, folder, _ = observed
    again = Recording.load(folder / record.name / "run_0" / "frames.npz")
    for name in ("rows", "places", "votes", "heading_votes", "peaks", "prior", "particles"):
        assert np.array_equal(getattr(again, name), getattr(recording, name)), name
    assert again.panoramas == recording.panoramas
    assert again.references == recording.references
    assert again.elevation_deg == recording.elevation_deg
    assert set(again.references) == set(record.best_place.tolist())


def test_it_holds_what_was_seen(observed):
    import cv2

    record, _, recording, _, _, (task, panorama_map, model, _) = observed
    assert recording.rows.tolist() == list(range(len(record)))
    assert recording.particles.shape == (len(record), 300, 3)
    unwrap = panorama_map.unwrapper(task.drive.camera, task.drive.image_size)
    from panoloc_mcl.tools.datasets import read_image

    panorama = unwrap(read_image(task.drive.files[3]))
    shown = cv2.imdecode(np.frombuffer(recording.panoramas[3], dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.abs(shown - panorama.pixels).mean() < 5.0
    field = model.observe(panorama)
    votes = field.votes.max(axis=0)
    assert recording.field(3) == pytest.approx(votes, abs=float(votes.max()) / 255)
    of_headings = recording.heading_votes[3] * (recording.peaks[3] / 255)
    asked = np.rint(np.degrees(field.headings)).astype(int)
    assert of_headings[asked] == pytest.approx(field.votes.max(axis=1), abs=float(votes.max()) / 100)


def test_of_many_frames_some_are_kept(observed):
    record, *_, (task, panorama_map, model, config) = observed
    recorder = FrameRecorder(most_frames=5)
    recorder.open(Scene(panorama_map.name, panorama_map.references, model.places, (len(task.drive),)))
    localize(task, 0, panorama_map, model, config, recorder)
    assert recorder.recording.rows.tolist() == list(range(0, len(record), 3))
    assert recorder.recording.frame_of(3) == 1
    with pytest.raises(ResultsError, match="frame 4: was not recorded; there are 0 to 9 in steps of 3"):
        recorder.recording.frame_of(4)


def test_only_the_first_run_is_kept(observed):
    *_, (task, panorama_map, model, config) = observed
    recorder = FrameRecorder()
    recorder.open(Scene(panorama_map.name, panorama_map.references, model.places, (len(task.drive),)))
    localize(task, 1, panorama_map, model, config, recorder)
    assert recorder.recording is None


def test_the_page_is_told_the_same(observed):
    import base64

    record, *_ = observed
    recording = observed[2]
    folder = observed[4]
    from panoloc_mcl.tools.report.results.steps import steps_text

    run = folder / record.name / "run_0"
    (run / "steps.csv").write_text(steps_text(record, observed[1]))
    page = run_data(record, folder)
    told = page["recording"]
    assert told["status"] == list(record.status)
    assert page["position_error"] == pytest.approx(record.position_error_m, abs=1e-5)
    low, high = np.array(told["bounds"][:2]), np.array(told["bounds"][2:])
    packed = np.frombuffer(base64.b64decode(told["particles"]), dtype="<u2").reshape(recording.particles.shape) / 65535
    inside = np.all((recording.particles[..., :2] > low) & (recording.particles[..., :2] < high), axis=-1)
    unpacked = low + packed[..., :2] * (high - low)
    assert unpacked[inside] == pytest.approx(recording.particles[..., :2][inside], abs=1e-3)
    # Every place is on its raster, and votes are those of the place.
    (x, y, step), grid = grid_of(recording.places, recording.spacing)
    columns, rows = np.rint((recording.places - [x, y]) / step).astype(int).T
    assert np.array_equal(grid[rows, columns], np.arange(len(recording.places)))
    votes = np.frombuffer(base64.b64decode(told["votes"]), dtype=np.uint8).reshape(len(recording), *grid.shape)
    assert np.array_equal(votes[:, rows, columns], recording.votes)


def test_places_off_a_grid_have_cells_around_them():
    places = np.random.default_rng(0).uniform(0, 5, (40, 2))
    (x, y, step), grid = grid_of(places, 0.6)
    columns, rows = np.rint((places - [x, y]) / step).astype(int).T
    assert np.mean(grid[rows, columns] == np.arange(40)) > 0.7
    assert grid.size < 7000
    assert grid_of(np.random.default_rng(1).uniform(0, 500, (4000, 2)), 1.0)[1].size < 7000
    assert grid_of(np.zeros((1, 2)), 1.0)[1].tolist() == [[0]]


def test_thinning_is_fair_and_always_the_same():
    particles = np.arange(12.0).reshape(4, 3)
    drawn = thinned(particles, np.array([0.0, 0.5, 0.25, 0.25]), 8)
    assert [int(np.sum(drawn[:, 0] == row[0])) for row in particles] == [0, 4, 2, 2]
    assert thinned(np.zeros((0, 3)), np.zeros(0), 8).shape == (0, 3)


@pytest.mark.parametrize("change", ["cut", "foreign", "version"])
def test_damaged_recordings_are_told(observed, tmp_path, change):
    from panoloc_mcl.robot.files import read_arrays, write_arrays

    source = observed[4] / observed[0].name / "run_0" / "frames.npz"
    path = tmp_path / "frames.npz"
    header, arrays = read_arrays(source)
    if change == "cut":
        arrays["panoramas"] = arrays["panoramas"][:-5]
    elif change == "version":
        header["format"] = "panoloc-frames/9"
    else:
        arrays["votes"] = arrays["votes"][:, 1:]
    write_arrays(path, header, arrays)
    with pytest.raises(ResultsError, match="run again") as caught:
        Recording.load(path)
    assert len(caught.value.faults) == 1


def test_a_folder_that_cannot_be_written_is_told(observed):
    with pytest.raises(OutputError, match="cannot be written"):
        observed[2].save(Path("/proc/nowhere/frames.npz"))
