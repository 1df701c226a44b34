import numpy as np
import pytest
from oracles.scenes import grid, references, texture

WORLD = references([texture(seed) for seed in range(6)], grid(3, 2))


@pytest.fixture
def script(load_script):
    return load_script("pose_faults")


def test_each_disturbance_is_what_it_is_called(script) -> None:
    swapped, neighbours, shifted, turned = (
        script.disturbed(WORLD, kind, np.random.default_rng(seed)) for seed, kind in enumerate(script.KINDS)
    )
    for world, bad in (swapped, neighbours):
        first, second = bad
        assert np.array_equal(world.positions[first], WORLD.positions[second])
        assert np.array_equal(world.positions[second], WORLD.positions[first])
    first, second = neighbours[1]
    assert np.hypot(*(WORLD.positions[first] - WORLD.positions[second])) == pytest.approx(1.0)
    world, (index,) = shifted
    assert np.hypot(*(world.positions[index] - WORLD.positions[index])) == pytest.approx(1.5)
    world, (index,) = turned
    columns = WORLD.pixels.shape[2] // 12
    assert any(np.array_equal(world.pixels[index], np.roll(WORLD.pixels[index], way * columns, axis=1)) for way in (-1, 1))
    for world, bad in (swapped, neighbours, shifted, turned):
        good = np.delete(np.arange(6), bad)
        assert np.array_equal(world.positions[good], WORLD.positions[good])
        assert np.array_equal(world.pixels[good], WORLD.pixels[good])


def test_disturbing_all_names_nobody(script) -> None:
    world, bad = script.disturbed(WORLD, script.RMS, np.random.default_rng(0))
    assert bad == []
    assert 0.01 < np.std(world.positions - WORLD.positions) < 0.03


def test_only_what_is_near_the_disturbed_ones_is_looked_at(script) -> None:
    part = script.near(WORLD, WORLD, [0], 1.1)
    assert part.names == ("ref_0.png", "ref_1.png", "ref_3.png")
