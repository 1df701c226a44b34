"""``panoloc live``: input, engine, outputs and the saved state put together."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack

from panoloc_mcl.robot.camera import Camera
from panoloc_mcl.robot.camera.files import read_camera
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.floors import AnyLocalizer, FloorLocalizer, Transition
from panoloc_mcl.robot.interface.keeper import StateKeeper
from panoloc_mcl.robot.interface.messages import Message
from panoloc_mcl.robot.localizer import Localizer
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config.live import LiveConfig
from panoloc_mcl.tools.datasets import Sequence as Drive
from panoloc_mcl.tools.datasets import read_dataset, resolve_dataset
from panoloc_mcl.tools.live.engine import Engine, Figures, Output
from panoloc_mcl.tools.live.foxglove_server import FoxgloveServer
from panoloc_mcl.tools.live.inputs import camera_images, played
from panoloc_mcl.tools.live.json_lines import JsonLines
from panoloc_mcl.tools.live.recorder import McapRecorder
from panoloc_mcl.tools.live.rerun_output import RerunOutput


def run_live(
    config: LiveConfig,
    stopped: threading.Event,
    notice: Callable[[str], None],
    show: Callable[[Figures], None] | None = None,
) -> Figures:
    """Run until the input ends or ``stopped`` is set; the state is saved and files are closed in any case.

    Parameters
    ----------
    config : LiveConfig
    stopped : threading.Event
        Set it to stop.
    notice : callable
        Is told what the user should read.
    show : callable, optional
        Is shown how it goes, about once a second.

    Raises
    ------
    PanolocError
        The map, the input or an output cannot be used.
    """
    maps = {path.stem: PanoramaMap.load(path) for path in config.every_map}
    drive = None if config.input.recording is None else _drive(config, next(iter(maps.values())))
    camera: Camera | None = drive.camera if drive is not None else None
    if config.camera is not None:
        camera = read_camera(config.camera)
    size = None if drive is None else drive.image_size
    localizer: AnyLocalizer
    if config.map is not None:
        localizer = Localizer(maps[config.map.stem], config, camera=camera, image_size=size)
    else:
        ways = [Transition(way.between, way.at, way.radius_m) for way in config.transitions]
        localizer = FloorLocalizer(maps, config, ways, camera=camera, image_size=size)
    with ExitStack() as stack:
        if config.state.file is not None:
            keeper = StateKeeper(localizer, config.state.file, config.state.every_s)
            if keeper.problem:
                notice(f"{keeper.problem}")
            elif keeper.resumed:
                notice(f"goes on from {config.state.file}")
            stack.enter_context(keeper)
        recorder = None if config.output.record is None else McapRecorder(config.output.record)
        outputs = _outputs(config, localizer, notice)
        if recorder is not None:
            outputs.append(recorder)
        source = config.input.video if drive is None else drive.name
        sources = f"image from {source}", "odometry" if drive is None else f"odometry from {source}"
        engine = Engine(localizer, outputs, config.input.rate == 0.0, config.missing_after_s, notice, sources)
        stack.enter_context(engine)
        if show is not None:
            stack.callback(_shown(engine, show))
        for message in _messages(config, drive, stopped):
            if recorder is not None:
                recorder.take(message)
            engine.put(message)
        engine.drain()
        return engine.figures()


def _drive(config: LiveConfig, panorama_map: PanoramaMap) -> Drive:
    camera = panorama_map.camera if config.camera is None else read_camera(config.camera)
    assert config.input.recording is not None
    dataset = read_dataset(resolve_dataset(config.input.recording), config.recording, camera)
    if config.input.sequence is None and len(dataset.sequences) != 1:
        names = ", ".join(dataset.sequences) or "none"
        raise DatasetError(f"input.recording = {config.input.recording}: holds several sequences ({names}); set input.sequence")
    return dataset.select("all" if config.input.sequence is None else [config.input.sequence])[0]


def _messages(config: LiveConfig, drive: Drive | None, stopped: threading.Event) -> Iterator[Message]:
    if drive is not None:
        return played(drive, config.input.rate, stopped)
    assert config.input.video is not None
    return camera_images(str(config.input.video), stopped)


def _outputs(config: LiveConfig, localizer: AnyLocalizer, notice: Callable[[str], None]) -> list[Output]:
    wanted, outputs = config.output, list[Output]()
    if wanted.json_lines:
        outputs.append(JsonLines(sys.stdout, wanted.movements))
    if wanted.foxglove.enabled:
        server = FoxgloveServer(localizer, wanted.foxglove.host, wanted.foxglove.port)
        notice(f"Foxglove: ws://{wanted.foxglove.host}:{server.port}")
        outputs.append(server)
    if wanted.rerun is not None:
        outputs.append(RerunOutput(localizer, wanted.rerun))
    return outputs


def _shown(engine: Engine, show: Callable[[Figures], None]) -> Callable[[], None]:
    """Start showing; call what this gives to end it."""
    ended = threading.Event()

    def loop() -> None:
        while not ended.wait(1.0):
            show(engine.figures())

    thread = threading.Thread(target=loop, name="panoloc-status", daemon=True)
    thread.start()

    def end() -> None:
        ended.set()
        thread.join()

    return end
