"""What the README and the pages of the documentation name exists, and the site builds."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.cli.main import commands
from panoloc_mcl.tools.config.model import RunConfig

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = {path: path.read_text(encoding="utf-8") for path in sorted((ROOT / "docs").rglob("*.md"))}
EVERYTHING = "\n".join([README, *PAGES.values()])


def found(pattern):
    return sorted(set(re.findall(pattern, EVERYTHING, flags=re.MULTILINE)))


@pytest.mark.parametrize("name", found(r"`((?:observation|localizer|kidnap)\.[a-z_.]+)`"))
def test_every_parameter_exists(name):
    model: Any = RunConfig
    *parts, last = name.split(".")
    for part in parts:
        model = model.model_fields[part].annotation
    assert last in model.model_fields


def test_tuning_goes_from_symptoms_to_parameters():
    rows = [row for row in PAGES[ROOT / "docs" / "how-to" / "tuning.md"].splitlines() if row.startswith("|")][2:]
    assert len(rows) > 10
    assert all("`" in row.split("|")[2] for row in rows)


@pytest.mark.parametrize("command", found(r"`(?:\| `)?panoloc ([a-z-]+)"))
def test_every_command_exists(command):
    assert command in {known.name for known in commands()}


def test_every_command_is_in_the_reference():
    reference = PAGES[ROOT / "docs" / "reference" / "commands.md"]
    assert [known.name for known in commands() if f"| `panoloc {known.name}" not in reference] == []


@pytest.mark.parametrize("path", found(r"(?:docs|scripts|configs)/[A-Za-z_/-]+\.[a-z]+"))
def test_every_file_exists(path):
    assert (ROOT / path).is_file()


def _of_architecture(pattern):
    return sorted(set(re.findall(pattern, (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8"))))


@pytest.mark.parametrize("path", _of_architecture(r"`([\w/]+\.(?:py|js|toml))`"))
def test_every_file_that_the_architecture_names_exists(path):
    assert [file for file in ROOT.rglob(Path(path).name) if file.as_posix().endswith("/" + path)]


@pytest.mark.parametrize("name", _of_architecture(r"`([A-Z]\w+\.\w+)`"))
def test_every_method_that_the_architecture_names_exists(name):
    owner, method = name.split(".")
    sources = [file.read_text(encoding="utf-8") for file in (ROOT / "panoloc_mcl").rglob("*.py")]
    assert any(f"class {owner}" in source for source in sources)
    assert any(re.search(rf"^    (?:def {method}\(|{method}: )", source, flags=re.MULTILINE) for source in sources)


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", README))))
def test_every_link_of_the_readme_leads_somewhere(link):
    assert (ROOT / link).exists()


def test_the_readme_is_a_page_and_a_half():
    assert len(README.splitlines()) <= 220


@pytest.mark.slow
def test_the_program_of_a_robot_runs(small_room, tmp_path, monkeypatch, capsys):
    program = re.search(r"```python\n(.*?)```", README.split("\n## On the robot\n")[1], flags=re.DOTALL)[1]
    assert len(program.splitlines()) <= 31
    PanoramaMap.build(small_room).save(tmp_path / "room.panomap")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["follow.py", str(tmp_path / "room.panomap"), str(small_room.path)])
    exec(compile(program, "follow.py", "exec"), {"__name__": "__main__"})
    first = capsys.readouterr().out
    assert first.startswith("no saved state: global localization\n")
    assert first.count("converged") >= 10
    exec(compile(program, "follow.py", "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out.startswith("resumed from the saved state\n")


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    program = Path(sys.executable).with_name("mkdocs")
    if not program.exists() and shutil.which("mkdocs") is None:
        pytest.skip("mkdocs is not installed")
    command = [program if program.exists() else "mkdocs", "build", "--strict", "--site-dir", tmp_path / "site"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "reference" / "api" / "index.html").is_file()
