"""Damaged files: the damage, the harness, and a few hundred inputs of what it does with a hundred thousand."""

import importlib
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoloc_mcl.laboratory.studies.robustness import fuzz as package
from panoloc_mcl.laboratory.studies.robustness.fuzz import Input, fuzz, mutated, originals, study
from panoloc_mcl.robot.errors import ConfigError, PanolocError

EXAMPLES = sorted((Path(__file__).parents[3] / "robot" / "camera" / "formats" / "examples").iterdir())


@given(st.binary(max_size=2000), st.binary(max_size=100), st.integers(0, 10_000))
@settings(max_examples=300, deadline=None)
def test_any_bytes_can_be_damaged_and_always_in_the_same_way(data: bytes, other: bytes, seed: int) -> None:
    once, again = (mutated(data, np.random.default_rng(seed), other) for _ in range(2))
    assert once == again


def test_damage_changes_a_file_nearly_always() -> None:
    data = Path(__file__).read_bytes()
    changed = [mutated(data, np.random.default_rng(seed), data) != data for seed in range(300)]
    assert sum(changed) > 270


@pytest.mark.slow
def test_originals_are_good(tmp_path: Path) -> None:
    for kind in originals(tmp_path, EXAMPLES):
        assert kind.files
        kind.read(tmp_path, kind.files[0])


@pytest.mark.slow
def test_no_damage_is_more_than_a_known_error() -> None:
    tallies = fuzz(250, seed=7, extra=EXAMPLES)
    assert {kind: dict(tally.failures) for kind, tally in tallies.items() if tally.failures} == {}
    assert sum(tally.inputs for tally in tallies.values()) == 250
    assert sum(tally.refused for tally in tallies.values()) > 50


@pytest.mark.slow
def test_some_kinds_have_the_inputs_that_they_have_among_all() -> None:
    everything = fuzz(60, seed=3)
    some = fuzz(60, seed=3, patterns=["PNG", "saved*"])
    assert list(some) == ["PNG", "saved state"]
    assert some == {name: everything[name] for name in some}
    with pytest.raises(ConfigError, match=r"--kinds nothing: no such kind; known: configuration of a run, .*PNG"):
        fuzz(60, seed=3, patterns=["nothing"])


def _dies(root: Path, file: Path) -> None:
    number = len((root / file).read_bytes()) % 5
    if number == 0:
        os._exit(3)
    if number == 1:
        raise ZeroDivisionError
    if number == 2:
        raise PanolocError("a line")
    if number == 3:
        (root / "left_behind.txt").write_text("x")


def test_what_dies_raises_or_leaves_files_is_seen(monkeypatch, tmp_path: Path) -> None:
    def two(folder: Path, extra: object) -> list[Input]:
        (folder / "a.txt").write_bytes(b"abcd" * 100 + b"wxyz")
        return [Input("dying", (Path("a.txt"),), lambda root, file: None if root == folder else _dies(root, file))]

    monkeypatch.setattr(importlib.import_module("panoloc_mcl.laboratory.studies.robustness.fuzz.study"), "originals", two)
    tally = fuzz(60, seed=0)["dying"]
    assert tally.inputs == 60
    assert tally.read + tally.refused + tally.failures.total() == 60
    assert tally.failures["process ended with 3"] >= 3
    assert any(what.startswith("ZeroDivisionError") for what in tally.failures)
    assert any(what.startswith("wrote") and "left_behind.txt" in what for what in tally.failures)
    text = study(20, seed=0).markdown()
    assert "| all | 20 |" in text
    assert package.Tally().inputs == 0
