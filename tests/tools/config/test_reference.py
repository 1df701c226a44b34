import re
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import BaseModel

from panoloc_mcl.tools.config import RunConfig
from panoloc_mcl.tools.config.reference import parameter_reference, units_of

ROOT = Path(__file__).parents[3]
UNITS = {"_m": "m", "_deg": "degrees", "_s": "s", "_px": "pixels", "_m_s": "m/s", "_deg_s": "degrees/s"}


def fields(model=RunConfig, prefix=""):
    """Every field of the configuration, with its dotted key."""
    for name, field in model.model_fields.items():
        yield f"{prefix}{name}", field
        for part in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from fields(part, f"{prefix}{name}.")


FIELDS = list(fields())


def test_the_file_is_the_generated_one():
    written = (ROOT / "CONFIGURATION.md").read_text(encoding="utf-8")
    assert written == parameter_reference(), "run: python -m panoloc_mcl.tools.config.reference > CONFIGURATION.md"


def test_the_command_that_the_file_names_makes_it():
    done = subprocess.run([sys.executable, "-m", "panoloc_mcl.tools.config.reference"], capture_output=True, check=True)
    assert done.stdout.decode() == parameter_reference()


@pytest.mark.parametrize(("key", "field"), FIELDS, ids=[key for key, _ in FIELDS])
def test_every_field_says_what_it_does(key, field):
    assert field.description
    assert field.description.rstrip("…").strip().endswith((".", ","))
    assert f"`{key}" in parameter_reference()


@pytest.mark.parametrize(("key", "field"), FIELDS, ids=[key for key, _ in FIELDS])
def test_the_unit_is_that_of_the_name(key, field):
    suffix = re.search(r"_(m_s|deg_s|m|deg|s|px)$", key)
    if suffix:
        assert units_of(field) == UNITS[suffix[0]]


def test_no_row_breaks_the_tables():
    for line in parameter_reference().splitlines():
        if line.startswith("|"):
            assert len(re.findall(r"(?<!\\)\|", line)) == 7
