import importlib
import json
import os
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import panoloc_mcl.robot.kernels
from panoloc_mcl.robot.kernels.examples import EXAMPLES, find

ROOT = Path(__file__).parents[3]

interpreted = pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="nothing is compiled")

# Run each mode with each model after a warm-up, and report which kernels were compiled once more for other types.
PROBE = """
import json, sys
from panoloc_mcl import load_config
from panoloc_mcl.robot.kernels.examples import EXAMPLES, find
from panoloc_mcl.tools.runs.pipeline import run
for name, example in EXAMPLES.items():
    find(name)(*example())
known = {name: len(find(name).signatures) for name in EXAMPLES}
for mode in ("monte_carlo", "kalman_orientation"):
    for model in ("votes", "paper"):
        run(load_config(sys.argv[1], [
            f"dataset={sys.argv[2]}", f"out={sys.argv[3]}", f"localizer.mode={mode}", f"observation.model={model}",
            "localizer.initial=known_heading", "observation.paper.hypotheses=4", "observation.paper.heading_step_deg=30",
        ]))
print(json.dumps([name for name in EXAMPLES if len(find(name).signatures) != known[name]]))
"""


def kernels():
    """Every function of the package ``kernels`` that is compiled."""
    for module in pkgutil.walk_packages(panoloc_mcl.robot.kernels.__path__, "panoloc_mcl.robot.kernels."):
        for name, thing in vars(importlib.import_module(module.name)).items():
            if hasattr(thing, "py_func") and thing.py_func.__module__ == module.name:
                yield f"{module.name.removeprefix('panoloc_mcl.robot.kernels.')}.{name}"


@interpreted
def test_every_kernel_has_an_example():
    assert set(EXAMPLES) == set(kernels())


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_gives_numbers(name):
    import numpy as np

    arguments = EXAMPLES[name]()
    result = find(name)(*arguments)
    # A kernel that works in place gives nothing back.
    for array in result if isinstance(result, tuple) else arguments if result is None else (result,):
        assert np.all(np.isfinite(array))


def test_the_time_of_each_is_printed(panoloc):
    done = panoloc("warmup")
    assert done.code == 0
    assert [line.split()[0] for line in done.lines] == [*EXAMPLES, "all"]
    assert all(re.search(r" \d+\.\d\d s$", line) for line in done.lines)


@pytest.mark.slow
@interpreted
def test_after_a_warmup_a_run_compiles_nothing(small_room, tmp_path):
    # An empty cache: building the map is part of it.
    done = subprocess.run(
        [sys.executable, "-c", PROBE, ROOT / "configs" / "global.yaml", small_room, tmp_path / "out"],
        capture_output=True,
        text=True,
        env={**os.environ, "PANOLOC_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == []
