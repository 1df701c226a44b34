"""The walls of ARCHITECTURE.md and the rules of the house, kept by the tools that know them."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def run_tool(*command):
    program = Path(sys.executable).with_name(command[0])
    if not program.exists() and shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    done = subprocess.run([program if program.exists() else command[0], *command[1:]], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_parts_import_only_what_they_may():
    run_tool("lint-imports", "--no-cache")


def test_types():
    run_tool("mypy")


def test_style():
    run_tool("ruff", "check", "--no-cache", ".")


def test_format():
    run_tool("ruff", "format", "--no-cache", "--check", ".")


def test_no_two_places_hold_the_same_logic():
    files = [str(path) for folder in ("panoloc_mcl", "scripts") for path in sorted((ROOT / folder).rglob("*.py"))]
    ignored = ("--ignore-comments", "--ignore-docstrings", "--ignore-imports", "--ignore-signatures")
    said = run_tool("symilar", "--duplicates", "6", *ignored, *files)
    assert "duplicates=0" in said, said


def test_no_folder_is_a_heap():
    """Folders of more than twelve files have sub-folders in which they are sorted."""
    folders = {path.parent for path in (ROOT / "panoloc_mcl").rglob("*.py")}
    heaps = {}
    for folder in folders:
        files = [path for path in folder.iterdir() if path.is_file() and path.name != "__init__.py"]
        sorted_in = [path for path in folder.iterdir() if path.is_dir() and any(path.glob("*.py"))]
        if len(files) > 12 and not sorted_in:
            heaps[folder.relative_to(ROOT).as_posix()] = len(files)
    assert heaps == {}


def test_one_file_one_idea():
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in (ROOT / "panoloc_mcl").rglob("*.py")}
    assert {path: length for path, length in lengths.items() if length >= 400} == {}
