"""Libraries that break, are missing, or work: each is tried in a process of its own, once. Needs Mitsuba."""

import json
import os
import subprocess
import sys

import pytest

pytest.importorskip("mitsuba")

from panoloc_mcl.laboratory.simulation.engine import llvm
from panoloc_mcl.laboratory.simulation.engine.llvm import VARIABLE, Choice, candidates, choose, try_library


@pytest.fixture(autouse=True)
def new_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.delenv("PANOLOC_MITSUBA_VARIANT", raising=False)


@pytest.fixture
def library(tmp_path):
    path = tmp_path / "libLLVM-99.so"
    path.write_bytes(b"no library at all")
    return path


@pytest.fixture
def tried(monkeypatch):
    """What was tried; the fate of a library is in its name."""
    said = []

    def pretend(path):
        said.append(path.name)
        return "" if "good" in path.name else "LLVM ERROR: Cannot select"

    monkeypatch.setattr(llvm, "try_library", pretend)
    return said


def test_a_file_that_is_no_library_is_named_and_harms_nobody(library):
    assert "cannot load it" in try_library(library)
    assert try_library(library.with_name("libLLVM-98.so")) == "no such file"


@pytest.mark.parametrize(
    ("child", "said"),
    [
        ("import os; os.abort()", "ends the process with SIGABRT"),
        (
            "import os, sys; print('LLVM ERROR: Cannot select: 0x5f: v8f32 = fminimum 0x6a', file=sys.stderr); os.abort()",
            "fminimum",
        ),
        ("raise SystemExit(3)", "ends the process with code 3"),
        ("import time; time.sleep(60)", "does not finish"),
    ],
)
def test_a_child_that_dies(library, monkeypatch, child, said):
    monkeypatch.setattr(llvm, "_TRIAL", child)
    monkeypatch.setattr(llvm, "_PATIENCE_S", 2.0)
    wrong = try_library(library)
    assert said in wrong
    assert "\n" not in wrong
    assert "0x" not in wrong


@pytest.mark.slow
def test_one_of_those_that_ought_to_work_does():
    recent = [path for path in candidates() if llvm._version(path) >= (17,)]
    if not recent:
        pytest.skip("no LLVM 17 or newer on this machine")
    assert "" in map(try_library, recent)


def test_the_newest_that_works_is_taken(tried, tmp_path, monkeypatch):
    names = ("libLLVM-20.so", "libLLVM-good.so.19", "libLLVM-good-18.so")
    monkeypatch.setattr(llvm, "candidates", lambda: [tmp_path / name for name in names])
    assert choose() == Choice(tmp_path / names[1], "")
    assert tried == ["libLLVM-20.so", "libLLVM-good.so.19"]


def test_newest_first_and_each_once(tmp_path, monkeypatch):
    for name in ("libLLVM-9.so.1", "libLLVM-16.so.1", "libLLVM.so.19.1"):
        (tmp_path / name).touch()
    (tmp_path / "libLLVM-19.so").symlink_to(tmp_path / "libLLVM.so.19.1")
    (tmp_path / "llvm-21" / "lib").mkdir(parents=True)
    (tmp_path / "llvm-21" / "lib" / "libLLVM.so").touch()
    monkeypatch.setattr(llvm, "_FOLDERS", (str(tmp_path), f"{tmp_path}/llvm-*/lib"))
    found = [path.relative_to(tmp_path).as_posix() for path in candidates() if path.is_relative_to(tmp_path)]
    assert found == ["llvm-21/lib/libLLVM.so", "libLLVM.so.19.1", "libLLVM-16.so.1", "libLLVM-9.so.1"]


def test_one_that_was_asked_for_and_breaks_is_named(tried, tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "libLLVM-16.so"))
    monkeypatch.setattr(llvm, "candidates", lambda: [tmp_path / "libLLVM-good.so"])
    found = choose()
    assert found.library == tmp_path / "libLLVM-good.so"
    assert f"{VARIABLE} = {tmp_path / 'libLLVM-16.so'}: LLVM ERROR" in found.remark
    assert "libLLVM-good.so instead" in found.remark
    monkeypatch.setattr(llvm, "candidates", list)
    assert choose().library is None
    assert "install LLVM" in choose().remark


def test_the_answer_is_remembered_until_something_changes(tried, tmp_path, monkeypatch):
    library = tmp_path / "libLLVM-good.so"
    library.touch()
    monkeypatch.setattr(llvm, "candidates", lambda: [library])
    for _ in range(3):
        assert choose().library == library
    assert len(tried) == 1
    library.write_bytes(b"another build")
    choose()
    assert len(tried) == 2
    monkeypatch.setattr(llvm, "_processor", lambda: "another one")
    choose()
    assert len(tried) == 3
    (tmp_path / "cache" / "llvm.json").write_text("[damaged")
    assert choose().library == library
    assert len(tried) == 4
    assert len(json.loads((tmp_path / "cache" / "llvm.json").read_text())) == 1


def test_a_cache_that_cannot_be_written_stops_nothing(tried, tmp_path, monkeypatch):
    (tmp_path / "cache").write_text("a file where the folder should be")
    monkeypatch.setattr(llvm, "candidates", lambda: [tmp_path / "libLLVM-good.so"])
    assert choose().library == tmp_path / "libLLVM-good.so"


@pytest.mark.parametrize(("variant", "code"), [("", 0), ("llvm_ad_rgb", 2)])
def test_without_one_that_works_it_is_scalar_and_said(library, variant, code):
    """In a process of its own: Mitsuba keeps the library that it was imported with."""
    program = (
        "from panoloc_mcl.laboratory.simulation.engine import backend, llvm; from panoloc_mcl.robot.errors import ConfigError\n"
        "llvm.candidates = list\n"
        "try:\n  used = backend.backend()\n  print(used.variant); print(used.remark)\n"
        "except ConfigError as error:\n  print(error); raise SystemExit(2)\n"
    )
    environment = {**os.environ, VARIABLE: str(library), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    if variant:
        environment["PANOLOC_MITSUBA_VARIANT"] = variant
    child = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert child.returncode == code, child.stderr
    lines = child.stdout.splitlines()
    assert lines[0] == "scalar_rgb" if code == 0 else VARIABLE in lines[0]
    assert str(library) in lines[-1]
    assert "install LLVM 17 or newer" in lines[-1]
