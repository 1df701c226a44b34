import pytest

# A room with a lamp, a window, a bright post to the north-east, and not much else.
TINY = """
name: tiny
site: {latitude_deg: 47, day_of_year: 172, north_deg: 90}
window_transmittance: 0.3
lights:
  day: {time_h: 12}
  lamp: {time_h: 0, sun: 0, sky: 0, lamps: 1}
  night: {time_h: 1}
places: {areas: [[-1, -1, 1, 1]], step_m: 1.0}
drive: [[-1.5, -1.5, 1.5, 1.5]]
clearance_m: 0.2
materials:
  dull: {albedo: 0.2}
  wall: {albedo: 0.5, pattern: tiles, contrast: 0.6, scale_m: 0.8}
  picture: {albedo: 0.45, pattern: poster, contrast: 0.9}
  shiny: {albedo: 0.95}
objects:
  - {kind: floor, area: [-3, -3, 3, 3], material: dull}
  - {kind: ceiling, area: [-3, -3, 3, 3], z: 3, material: dull}
  - {kind: wall, start: [-3, -3], end: [3, -3], height_m: 3, material: wall,
     openings: [{at_m: 2, width_m: 2, bottom_m: 1, height_m: 1, bars: 1}]}
  - {kind: wall, start: [3, -3], end: [3, 3], height_m: 3, material: wall}
  - {kind: wall, start: [3, 3], end: [-3, 3], height_m: 3, material: wall}
  - {kind: wall, start: [-3, 3], end: [-3, -3], height_m: 3, material: wall}
  - {kind: box, size_m: [1.2, 0.1, 1.6], material: picture, places: [[-2, 2.2, 0, 30], [2.6, -1, 0, 80]], movable: true}
  - {kind: cylinder, radius_m: 0.08, height_m: 2, material: shiny, places: [[2, 2, 0, 0]]}
  - {kind: lamp, size_m: [0.6, 0.6], lumen: 6000, places: [[0, 0, 2.8, 0]]}
"""

TINY_RUN = """
name: tiny
scene: tiny_scene.yaml
seed: 5
references_light: day
size: [60, 25]
rendering: {samples: 8}
sensor: {samples: 1}
sequences:
  - {name: day, light: day, frames: 3, every_s: 1.0, people: 1}
  - {name: lamp, light: lamp, frames: 2, every_s: 1.0, moved: 1.0, tilt_deg: 2, auto_exposure: true, drive: {kind: turn}}
"""


@pytest.fixture(scope="session")
def simulation_cache(tmp_path_factory):
    return tmp_path_factory.mktemp("simulation_cache")


@pytest.fixture(autouse=True)
def own_cache(simulation_cache, monkeypatch):
    monkeypatch.setenv("PANOLOC_CACHE_DIR", str(simulation_cache))


@pytest.fixture(scope="session")
def tiny_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiny")
    (folder / "tiny_scene.yaml").write_text(TINY)
    (folder / "tiny.yaml").write_text(TINY_RUN)
    return folder
