"""The benchmark of the simulator measures what it says, on a room that is quickly rendered."""

from pathlib import Path

import pytest

pytest.importorskip("mitsuba")

ROOM = """
name: bare
lights: {lamp: {sun: 0, sky: 0, lamps: 1}}
places: {areas: [[0, 0, 1, 0]], step_m: 1.0}
drive: [[-1, -1, 2, 1]]
materials: {white: {albedo: 0.5}}
objects:
  - {kind: floor, area: [-2, -2, 3, 2]}
  - {kind: lamp, places: [[0, 0, 2.5, 0]]}
"""
RUN = "{name: bare, scene: scene.yaml, references_light: lamp, size: [30, 12], rendering: {samples: 16}}"


@pytest.mark.slow
def test_it_has_a_row_for_each_variant(ask, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(ROOM)
    (tmp_path / "run.yaml").write_text(RUN)
    words = ("--config", tmp_path / "run.yaml", "--frames", "2", "--variants", "scalar_rgb", "no_such_variant")
    found, impossible = ask("benchmark", "simulation", *words).rows()
    assert found["variant"] == "scalar_rgb"
    assert found["frames a second"] > 0.0
    assert 0.0 <= found["a frame, processor s"] <= 1.0 / found["frames a second"] + 0.01  # one thread
    assert found["a light path, processor µs"] > 0.0
    assert found["a light, minutes"] >= 0.0
    assert 0.05 < found["peak memory, GB"] < 4.0
    assert set(impossible.values()) == {"no_such_variant", None}
