"""How fast ``panoloc simulate`` is, with LLVM and without: frames a second, light paths a second, peak memory.

Each variant of Mitsuba is measured in a process of its own, by the clock on the wall and by that of the processor, which other work on
the machine disturbs less. Light is carried with few paths and not taken from the cache; what it costs in full is that times the paths
of the configuration. The first frame, which compiles, is left out.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.laboratory.reports import Number, Report
from panoloc_mcl.laboratory.simulation.engine.backend import LLVM, SCALAR, backend
from panoloc_mcl.laboratory.simulation.optics import expose, ray_table
from panoloc_mcl.laboratory.simulation.renderer import Daylight, LightTransport, sources_of
from panoloc_mcl.laboratory.simulation.settings import load_simulation
from panoloc_mcl.laboratory.simulation.simulate import Simulation
from panoloc_mcl.laboratory.timing import in_a_process
from panoloc_mcl.robot.files import CACHE_VARIABLE
from panoloc_mcl.robot.progress import no_progress


def simulation(config: str, frames: int = 8, samples: int = 32, variants: Sequence[str] = (LLVM, SCALAR)) -> Report:
    """Measure each variant; one that this machine cannot use is a row of dashes.

    Parameters
    ----------
    config : str
        Configuration of a simulation.
    frames : int
    samples : int
        Light paths from each cell, a multiple of 8.
    variants : sequence of str
    """
    load_simulation(Path(config))
    report = Report(f"Simulating `{config}` on {os.cpu_count()} cores: {frames} frames.")
    heads = (
        "variant",
        "frames a second",
        "a frame, processor s",
        "a light path, processor µs",
        "a light, minutes",
        "peak memory, GB",
    )
    table = report.table("", heads)
    for variant in variants:
        found = _measured(variant, config, frames, samples)
        if found is None:
            table.add(variant, *[None] * 5)
            continue
        table.add(
            variant,
            Number(1.0 / found["frame_s"], 2),
            Number(found["frame_processor_s"], 2),
            Number(1e6 * found["path_processor_s"], 1),
            Number(found["path_s"] * found["paths"] / 60.0, 1),
            Number(found["peak_mb"] / 1024.0, 2),
        )
    return report


def _measured(variant: str, config: str, frames: int, samples: int) -> dict[str, Any] | None:
    """What `measure` finds with a variant, in an empty cache; None when this machine cannot use the variant."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "PANOLOC_MITSUBA_VARIANT": variant, CACHE_VARIABLE: folder}
        try:
            return in_a_process(f"{__name__}:measure", config, str(frames), str(samples), environment=environment)
        except subprocess.CalledProcessError:
            return None


def measure(path: str, frames: str, light_paths: str) -> dict[str, float | str]:
    """Seconds of a frame and of a light path, and light paths of the whole light, with the variant of this process."""
    config, samples = Path(path), int(light_paths)
    settings = load_simulation(config, [f"rendering.samples={max(8, samples)}"])
    simulation, used = Simulation(settings, config.parent), backend()
    world = simulation.world(settings.references_light, used, no_progress)
    patches, scene = world.building.patches, simulation.scene
    light = scene.lights[settings.references_light]
    sources = sources_of(patches, scene.site, light, scene.window_transmittance, used)
    transport = LightTransport(patches, sources, Daylight(scene.site, light), used)
    begin = _now()
    transport.light_map(samples, 1, lambda done, total: None)
    carried = _now() - begin
    rays = ray_table(settings.camera, settings.size, settings.sensor.samples)
    times = []
    for index in range(int(frames) + 1):
        pose = simulation.references[index % len(simulation.references)]
        begin = _now()
        seen = world.luminance(rays, pose, settings.camera.height_m or 0.0)
        expose(*seen, settings.sensor, np.random.default_rng(index))
        times.append(_now() - begin)
    frame, of_path = np.median(times[1:], axis=0), carried / (2 * patches.cells * samples)
    return {
        "variant": used.variant,
        "remark": used.remark,
        "frame_s": float(frame[0]),
        "frame_processor_s": float(frame[1]),
        "path_processor_s": float(of_path[1]),
        "path_s": float(of_path[0]),
        "paths": 2 * patches.cells * load_simulation(config).rendering.samples,
    }


def _now() -> NDArray[np.float64]:
    """The clock on the wall and that of the processor, all threads together, seconds."""
    return np.array([time.perf_counter(), time.process_time()])
