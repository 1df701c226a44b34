"""What the README names exists."""

import re
from pathlib import Path

import pytest

from panoloc_mcl.tools.cli.main import commands
from panoloc_mcl.tools.config.model import RunConfig

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def section(title):
    return README.split(f"\n## {title}\n")[1].split("\n## ")[0]


def parameters():
    return sorted(set(re.findall(r"`((?:observation|localizer|kidnap)\.[a-z_.]+)`", README)))


@pytest.mark.parametrize("name", parameters())
def test_every_parameter_exists(name):
    model = RunConfig
    *parts, last = name.split(".")
    for part in parts:
        model = model.model_fields[part].annotation
    assert last in model.model_fields


def test_tuning_goes_from_symptoms_to_parameters():
    rows = [row for row in section("Tuning").splitlines() if row.startswith("|")][2:]
    assert len(rows) > 10
    assert all("`" in row.split("|")[2] for row in rows)


@pytest.mark.parametrize("command", sorted(set(re.findall(r"^\| `panoloc ([a-z-]+)", README, flags=re.MULTILINE))))
def test_every_command_exists(command):
    assert command in {known.name for known in commands()}


@pytest.mark.parametrize("path", sorted(set(re.findall(r"(?:docs|scripts|configs)/[A-Za-z_]+\.[a-z]+", README))))
def test_every_file_exists(path):
    assert (Path(__file__).parents[1] / path).is_file()
