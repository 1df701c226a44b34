import io
import json
import math
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from panoloc_mcl.robot.errors import OutputError
from panoloc_mcl.robot.filters import Status
from panoloc_mcl.robot.interface.answers import TimedPose
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import read_image
from panoloc_mcl.tools.datasets.recordings import sequence_of
from panoloc_mcl.tools.live import Answer, Engine
from panoloc_mcl.tools.live.inputs import played
from panoloc_mcl.tools.live.json_lines import JsonLines
from panoloc_mcl.tools.live.recorder import McapRecorder
from panoloc_mcl.tools.streams import Image, Odometry, answers, recorded


class Collected:
    """Remembers what it is told."""

    def __init__(self, seconds: float = 0.0) -> None:
        self.answers: list[Answer] = []
        self.moves: list[tuple[TimedPose, TimedPose]] = []
        self.closed, self._seconds = 0, seconds

    def answered(self, answer) -> None:
        time.sleep(self._seconds)
        self.answers.append(answer)

    def moved(self, robot, odometry) -> None:
        self.moves.append((robot, odometry))

    def close(self) -> None:
        self.closed += 1


def test_with_time_for_every_image_it_answers_as_a_run_does(panorama_map: PanoramaMap, drive: Drive) -> None:
    expected = [estimate.pose for _, estimate in answers(Localizer(panorama_map), recorded(drive))]
    output, stream = Collected(), io.StringIO()
    with Engine(Localizer(panorama_map), [output, JsonLines(stream, movements=True)], keep_all=True) as engine:
        for message in played(drive, 0.0, threading.Event()):
            engine.put(message)
            if isinstance(message, Image):
                engine.drain()
    assert np.array_equal([answer.estimate.pose for answer in output.answers], expected)
    assert output.closed == 1
    assert engine.figures().dropped == 0
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert [line["pose"] for line in lines if line["kind"] == "answer"] == [pose.tolist() for pose in expected]
    assert sum(line["kind"] == "pose" for line in lines) == len(output.moves) > 0
    robot, frame = output.moves[-1]
    assert frame.timestamp == robot.timestamp


def test_a_slow_reader_gets_the_newest_image_and_the_others_are_counted(panorama_map: PanoramaMap, drive: Drive) -> None:
    slow = Collected(seconds=0.2)
    images = [message for message in recorded(drive) if isinstance(message, Image)]
    with Engine(Localizer(panorama_map), [slow]) as engine:
        for image in images:
            engine.put(image)
            time.sleep(0.02)
        engine.drain()
        figures = engine.figures()
    assert figures.dropped > 0
    assert figures.images + figures.dropped == len(images)
    assert slow.answers[-1].image.timestamp == images[-1].timestamp
    assert figures.latency_ms < 1.5 * figures.step_ms + 250.0


def test_what_does_not_come_is_named_after_five_seconds(panorama_map: PanoramaMap, drive: Drive, monkeypatch) -> None:
    begun = time.monotonic()
    now = [begun]
    monkeypatch.setattr("panoloc_mcl.tools.live.engine.time.monotonic", lambda: now[0])
    with Engine(Localizer(panorama_map), sources=("image on /omni/image", "odometry on /odom")) as engine:
        now[0] = begun + 4.9
        assert engine.figures().message == ""
        now[0] = begun + 5.6
        assert engine.figures().message == "no image on /omni/image for 6 s; no odometry on /odom for 6 s"
        engine.put(next(message for message in recorded(drive) if isinstance(message, Odometry)))
        assert engine.figures().message == "no image on /omni/image for 6 s"


def test_odometry_that_is_left_out_moves_nobody(panorama_map: PanoramaMap, drive: Drive) -> None:
    output = Collected()
    with Engine(Localizer(panorama_map), [output], keep_all=True) as engine:
        for message in list(recorded(drive))[:60]:
            engine.put(message)
            engine.drain()
        before, last = len(output.moves), next(message for message in recorded(drive) if isinstance(message, Odometry))
        newest = output.moves[-1][0].timestamp
        for stamp in (math.nan, newest + 5000.0, 1e12, newest - 5000.0):
            assert not engine.put(replace(last, timestamp=stamp))
        assert len(output.moves) == before


def test_an_output_that_fails_stops_nothing(panorama_map: PanoramaMap, drive: Drive) -> None:
    class Failing(Collected):
        def answered(self, answer) -> None:
            raise RuntimeError("disk full")

    told: list[str] = []
    after = Collected()
    with Engine(Localizer(panorama_map), [Failing(), after], keep_all=True, notice=told.append) as engine:
        for message in list(recorded(drive))[:20]:
            engine.put(message)
        engine.drain()
    assert "RuntimeError: disk full" in told
    assert after.answers


def test_a_frozen_camera_is_said_and_not_believed(panorama_map: PanoramaMap, drive: Drive) -> None:
    output = Collected()
    stuck = next(message for message in recorded(drive) if isinstance(message, Image)).pixels()
    assert isinstance(stuck, np.ndarray)
    told: list[str] = []
    with Engine(Localizer(panorama_map), [output], keep_all=True, notice=told.append) as engine:
        for message in recorded(drive):
            engine.put(replace(message, source=stuck) if isinstance(message, Image) else message)
            engine.drain()
    frozen = [answer.estimate for answer in output.answers if "frozen" in answer.estimate.message]
    assert len(frozen) > 6
    # To the user when it comes up first, as every other reason, however many images there are.
    kinds = {reason for answer in output.answers for reason in answer.estimate.reasons}
    assert "frozen" in told[0]
    assert len(told) <= len(kinds) < 4
    assert frozen[-1].status is not Status.CONVERGED
    moved = np.hypot(*(output.moves[-1][0].pose[:2] - output.answers[0].estimate.pose[:2]))
    truth = np.hypot(*(drive.groundtruth.poses[-1, :2] - drive.groundtruth.poses[0, :2]))
    assert moved == pytest.approx(truth, abs=0.5)


def test_what_is_recorded_can_be_run_again(panorama_map: PanoramaMap, drive: Drive, tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "seen.mcap")
    with Engine(Localizer(panorama_map), [recorder], keep_all=True) as engine:
        for message in recorded(drive):
            recorder.take(message)
            engine.put(message)
        engine.drain()
    found = sequence_of(tmp_path / "seen.mcap", camera=drive.camera)
    assert found.times == pytest.approx(drive.times, abs=1e-9)
    fourth = next(m for m in recorded(drive) if isinstance(m, Image) and m.index == 3).pixels()
    assert isinstance(fourth, np.ndarray)
    assert np.array_equal(read_image(found.files[3]), fourth)
    assert found.odometry is not None
    assert found.odometry.poses == pytest.approx(drive.odometry.poses[: len(found.odometry)], abs=1e-9)
    with pytest.raises(OutputError, match="cannot be written"):
        McapRecorder(tmp_path / "seen.mcap")


def test_played_in_real_time_it_takes_as_long(drive: Drive) -> None:
    begun, span = time.monotonic(), drive.times[-1] - min(drive.times[0], drive.odometry.times[0])
    count = sum(1 for _ in played(drive, span / 0.3, threading.Event()))
    assert count > len(drive)
    assert 0.25 < time.monotonic() - begun < 3.0
    stopped = threading.Event()
    stopped.set()
    assert list(played(drive, 1.0, stopped)) == []
