"""The robot's wing on a machine that has nothing but the libraries it may use: it is imported whole, and it localizes."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import pytest

import panoloc_mcl
from panoloc_mcl.robot.files import CACHE_VARIABLE

# The names of the packages to install; what they need themselves comes with them.
ALLOWED = (
    "numpy",
    "scipy",
    "opencv-python-headless",
    "numba",
    "pydantic",
    "pyyaml",
    "safetensors",
    "threadpoolctl",
    "platformdirs",
)

BLOCK = """
import sys

class Without:
    def __init__(self, finder):
        self.finder = finder

    def find_spec(self, name, path=None, target=None):
        if name.startswith({wings!r}) or name.partition(".")[0] in {missing!r}:
            return None
        return self.finder.find_spec(name, path, target)

    def __getattr__(self, name):
        return getattr(self.finder, name)

sys.meta_path[:] = [Without(finder) for finder in sys.meta_path]
"""

IMPORT = """
import importlib, pkgutil
import panoloc_mcl.robot
for module in pkgutil.walk_packages(panoloc_mcl.robot.__path__, "panoloc_mcl.robot."):
    importlib.import_module(module.name)
for name in ("Localizer", "PanoramaMap", "Estimate", "Status", "PanolocError"):
    getattr(panoloc_mcl, name)
"""

# Seen from the middle of the embedded hall: nine references, one image of a drive, start unknown.
LOCALIZE = f"""
import csv
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from panoloc_mcl import Localizer, PanoramaMap
from panoloc_mcl.robot.camera import camera_from_mapping
from panoloc_mcl.robot.references import References
from panoloc_mcl.robot.settings.validation import read_yaml

HALL = Path({str(Path(panoloc_mcl.__file__).parent)!r}) / "tools" / "datasets" / "embedded_hall"

@dataclass
class Recorded:
    name: str
    references: References

rows = list(csv.DictReader((HALL / "references" / "poses.csv").read_text().splitlines()))
poses = np.array([[float(row[key]) for key in ("x", "y", "theta")] for row in rows])
drive = HALL / "sequences" / "noon_00"
truth = [[float(number) for number in line.split()] for line in (drive / "groundtruth.tum").read_text().splitlines() if line[0] != "#"]
frame = next(csv.DictReader((drive / "frames.csv").read_text().splitlines()))
stamp, x, y = min(truth, key=lambda row: abs(row[0] - float(frame["timestamp"])))[:3]
near = np.argsort(np.hypot(*(poses[:, :2] - (x, y)).T))[:9]
files = tuple(HALL / "references" / rows[index]["file"] for index in near)
height, width = cv2.imread(str(files[0])).shape[:2]
camera = camera_from_mapping(read_yaml(HALL / "dataset.yaml")["camera"], "dataset.yaml")
built = PanoramaMap.build(Recorded("hall", References(HALL / "references", files, poses[near], camera, (width, height))))
built.save("hall.panomap")
localizer = Localizer(PanoramaMap.load("hall.panomap"))
localizer.add_odometry(stamp, (0.0, 0.0, 0.0))
estimate = localizer.add_image(stamp, cv2.imread(str(drive / frame["file"])))
localizer.save_state("state.npz")
localizer.load_state("state.npz")
assert np.hypot(estimate.pose[0] - x, estimate.pose[1] - y) < 0.1, (estimate.pose, x, y)
"""

REFUSED = """
for name in ("rich", "jinja2", "plotly", "matplotlib", "panoloc_mcl.tools", "panoloc_mcl.laboratory"):
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        continue
    raise AssertionError(name + " is not blocked")
"""


def missing(of: Sequence[str]) -> set[str]:
    """Every name that some installed package but these, and what they need, gives."""
    allowed: set[str] = set()
    to_do = list(of)
    while to_do:
        name = canonical(to_do.pop())
        if name not in allowed and installed(name):
            allowed.add(name)
            # Of requirements like 'scipy>=1.11; extra == "test"', those that no extra asks for.
            needs = [line for line in metadata.requires(name) or () if "extra ==" not in line]
            to_do += [re.match(r"[\w.-]+", line)[0] for line in needs]
    return {
        module
        for module, givers in metadata.packages_distributions().items()
        if module != "panoloc_mcl" and not allowed & {canonical(giver) for giver in givers}
    }


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def installed(name: str) -> bool:
    try:
        metadata.distribution(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def on_a_bare_robot(
    code: str,
    folder: Path,
    packages: Sequence[str] = ALLOWED,
    wings: tuple[str, ...] = ("panoloc_mcl.tools", "panoloc_mcl.laboratory"),
) -> None:
    blocked = BLOCK.format(missing=missing(packages), wings=wings)
    done = subprocess.run([sys.executable, "-c", blocked + code], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_every_module_is_imported(tmp_path):
    on_a_bare_robot(IMPORT + REFUSED, tmp_path)


@pytest.mark.slow
def test_it_builds_a_map_and_localizes(tmp_path):
    on_a_bare_robot(LOCALIZE, tmp_path)


@pytest.mark.slow
def test_the_base_install_runs_without_any_extra(small_room, tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    packages = [re.match(r"[\w.-]+", line)[0] for line in project["dependencies"]]
    config = tmp_path / "run.yaml"
    config.write_text(f"name: base\ndataset: {small_room.path}\n")
    code = f"from panoloc_mcl.tools.cli.main import main\nassert main(['run', {str(config)!r}, '--out', 'results']) == 0"
    on_a_bare_robot(code, tmp_path, packages, wings=())
    assert (tmp_path / "results" / "base" / "latest" / "metrics.json").is_file()
