"""The walls of ARCHITECTURE.md and the rules of the house, kept by the tools that know them."""

import ast
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def run_tool(*command):
    program = Path(sys.executable).with_name(command[0])
    if not program.exists() and shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    done = subprocess.run([program if program.exists() else command[0], *command[1:]], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_parts_import_only_what_they_may():
    run_tool("lint-imports", "--no-cache")


@pytest.mark.slow
def test_types():
    run_tool("mypy")


def test_style():
    run_tool("ruff", "check", "--no-cache", ".")


def test_format():
    run_tool("ruff", "format", "--no-cache", "--check", ".")


def code_lines(path):
    """Numbers and texts of the lines that are code: no comments, docstrings, imports or signatures."""
    text = path.read_text(encoding="utf-8")
    skipped = set()
    for node in ast.walk(ast.parse(text)):
        docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        if isinstance(node, ast.stmt) and (docstring or isinstance(node, ast.Import | ast.ImportFrom)):
            skipped |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        if isinstance(node, ast.FunctionDef):
            skipped |= set(range(node.lineno, node.body[0].lineno))
    lines = ((number, line.strip()) for number, line in enumerate(text.splitlines(), start=1))
    return [(number, line) for number, line in lines if line and number not in skipped and not line.startswith("#")]


def repeated_runs(paths, count):
    """Where the same lines of code stand in a row in two places. Lines of a bracket or a word alone say nothing."""
    places = defaultdict(list)
    for path in paths:
        lines = code_lines(path)
        for start in range(len(lines) - count + 1):
            run = tuple(line for _, line in lines[start : start + count])
            if sum(len(line) > 3 for line in run) >= count - 1:
                places[run].append(f"{path.name}:{lines[start][0]}")
    return {" | ".join(where): run for run, where in places.items() if len(where) > 1}


def test_a_repeated_run_is_found(tmp_path):
    one, other = tmp_path / "one.py", tmp_path / "other.py"
    one.write_text('"""Doc."""\nimport os\nfirst = 1\nsecond = 2\nthird = 3\n')
    other.write_text("other = 0\nfirst = 1\n# said\nsecond = 2\nthird = 3\n")
    assert list(repeated_runs([one, other], 3)) == ["one.py:3 | other.py:2"]
    assert repeated_runs([one, other], 4) == {}


def test_no_two_places_hold_the_same_logic():
    files = [path for folder in ("panoloc_mcl", "scripts") for path in sorted((ROOT / folder).rglob("*.py"))]
    # Kernels are loops that are written out: two of resampling begin with the same sum.
    files = [path for path in files if "kernels" not in path.parts]
    assert repeated_runs(files, 6) == {}


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
    assert {path: length for path, length in lengths.items() if length > 350} == {}
