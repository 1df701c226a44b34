"""How fast ``panoloc simulate`` is, with LLVM and without: frames a second, light paths a second, peak memory. Prints Markdown.

    python scripts/benchmark_simulate.py [--config configs/simulate_hall.yaml] [--frames N] [--samples N] [--variants V …]

Each variant of Mitsuba is measured in a process of its own, by the clock on the wall and by that of the processor, which other work on
the machine disturbs less. Light is carried with few paths (``--samples``) and not
taken from the cache; what it costs in full is that times the paths of the configuration. The first frame, which compiles, is left out.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from panoloc_mcl.laboratory.simulation.backend import LLVM, SCALAR, backend
from panoloc_mcl.laboratory.simulation.optics import expose, ray_table
from panoloc_mcl.laboratory.simulation.renderer import Daylight, LightTransport, sources_of
from panoloc_mcl.laboratory.simulation.settings import load_simulation
from panoloc_mcl.laboratory.simulation.simulate import Simulation
from panoloc_mcl.robot.files import CACHE_VARIABLE
from panoloc_mcl.robot.progress import no_progress


def measure(config: Path, frames: int, samples: int) -> dict[str, float | str]:
    """Seconds of a frame and of a light path, light paths of the whole light, peak memory; with the variant of this process."""
    settings = load_simulation(config, [f"rendering.samples={max(8, samples)}"])
    simulation, used = Simulation(settings, config.parent), backend()
    world = simulation.world(settings.references_light, used, no_progress)
    patches, scene = world.building.patches, simulation.scene
    light = scene.lights[settings.references_light]
    sources = sources_of(patches, scene.site, light, scene.window_transmittance, used)
    transport = LightTransport(patches, sources, Daylight(scene.site, light), used)
    begin = _now()
    transport.light_map(samples, 1, no_progress_of_light)
    carried = _now() - begin
    rays = ray_table(settings.camera, settings.size, settings.sensor.samples)
    times = []
    for index in range(frames + 1):
        pose = simulation.references[index % len(simulation.references)]
        begin = _now()
        seen = world.luminance(rays, pose, settings.camera.height_m or 0.0)
        expose(*seen, settings.sensor, np.random.default_rng(index))
        times.append(_now() - begin)
    frame, path = np.median(times[1:], axis=0), carried / (2 * patches.cells * samples)
    return {
        "variant": used.variant,
        "remark": used.remark,
        "frame_s": float(frame[0]),
        "frame_processor_s": float(frame[1]),
        "path_processor_s": float(path[1]),
        "path_s": float(path[0]),
        "paths": 2 * patches.cells * load_simulation(config).rendering.samples,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def _now() -> np.ndarray:
    """The clock on the wall and that of the processor, all threads together, seconds."""
    return np.array([time.perf_counter(), time.process_time()])


def no_progress_of_light(done: int, total: int) -> None:
    """Nobody watches."""


def in_a_process(variant: str, config: Path, frames: int, samples: int) -> dict[str, float | str] | None:
    """What `measure` finds with a variant, in an empty cache; None when this machine cannot use the variant."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "PANOLOC_MITSUBA_VARIANT": variant, CACHE_VARIABLE: folder}
        command = [
            sys.executable,
            __file__,
            "--measure",
            "--config",
            str(config),
            "--frames",
            str(frames),
            "--samples",
            str(samples),
        ]
        child = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    return dict(json.loads(child.stdout.splitlines()[-1])) if child.returncode == 0 else None


def main(argv: list[str] | None = None) -> int:
    """Measure each variant, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", type=Path, default=Path("configs/simulate_hall.yaml"))
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--samples", type=int, default=32, help="light paths from each cell, a multiple of 8")
    parser.add_argument("--variants", nargs="+", default=[LLVM, SCALAR])
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args(argv)
    if arguments.samples < 8 or arguments.samples % 8 or arguments.frames < 1:
        parser.error("--samples must be a multiple of 8, --frames 1 or more")
    if arguments.measure:
        print(json.dumps(measure(arguments.config, arguments.frames, arguments.samples)))
        return 0
    print(f"{arguments.config}, {os.cpu_count()} cores\n")
    print(
        "| variant | frames a second | a frame, processor s | a light path, processor µs | a light, minutes | peak memory, GB |"
    )
    print("|---|---|---|---|---|---|")
    for variant in arguments.variants:
        found = in_a_process(variant, arguments.config, arguments.frames, arguments.samples)
        if found is None:
            print(f"| {variant} | – | – | – | – | – |", flush=True)
            continue
        cells = (
            f"{1.0 / float(found['frame_s']):.2f}",
            f"{float(found['frame_processor_s']):.2f}",
            f"{1e6 * float(found['path_processor_s']):.1f}",
            f"{float(found['path_s']) * float(found['paths']) / 60.0:.1f}",
            f"{float(found['peak_mb']) / 1024.0:.2f}",
        )
        print(f"| {variant} | {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
