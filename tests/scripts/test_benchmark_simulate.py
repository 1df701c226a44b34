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


def test_it_prints_a_row_for_each_variant(load_script, tmp_path: Path, capsys) -> None:
    (tmp_path / "scene.yaml").write_text(ROOM)
    (tmp_path / "run.yaml").write_text(RUN)
    script = load_script("benchmark_simulate")
    assert script.main(["--config", str(tmp_path / "run.yaml"), "--frames", "2", "--variants", "scalar_rgb"]) == 0
    row = [cell.strip() for cell in capsys.readouterr().out.splitlines()[-1].strip("|").split("|")]
    assert row[0] == "scalar_rgb"
    rate, frame, path, light, peak = (float(cell) for cell in row[1:])
    assert rate > 0.0
    assert 0.0 <= frame <= 1.0 / rate + 0.01  # one thread
    assert path > 0.0
    assert light >= 0.0
    assert 0.05 < peak < 4.0


def test_a_variant_that_cannot_be_used_is_a_row_of_dashes(load_script, tmp_path: Path) -> None:
    script = load_script("benchmark_simulate")
    assert script.in_a_process("no_such_variant", tmp_path / "run.yaml", 1, 8) is None
