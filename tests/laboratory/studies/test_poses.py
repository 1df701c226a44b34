import numpy as np
import pytest
from oracles.scenes import grid, references, texture

from panoloc_mcl.laboratory.studies import poses

WORLD = references([texture(seed) for seed in range(6)], grid(3, 2))


def test_each_disturbance_is_what_it_is_called() -> None:
    swapped, neighbours, shifted, turned = (
        poses.disturbed(WORLD, kind, np.random.default_rng(seed)) for seed, kind in enumerate(poses.KINDS)
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


def test_disturbing_all_names_nobody() -> None:
    world, bad = poses.disturbed(WORLD, poses.RMS, np.random.default_rng(0))
    assert bad == []
    assert 0.01 < np.std(world.positions - WORLD.positions) < 0.03


def test_only_what_is_near_the_disturbed_ones_is_looked_at() -> None:
    part = poses.near(WORLD, WORLD, [0], 1.1)
    assert part.names == ("ref_0.png", "ref_1.png", "ref_3.png")


@pytest.mark.slow
def test_a_wrong_pose_is_left_out_and_no_right_one(ask, small_room):
    answer = ask("study", "poses", "--dataset", small_room.path, "--draws", "1")
    assert answer.code == 0
    rows = {row["disturbance"]: row for row in answer.rows()}
    assert list(rows) == ["as it is", *poses.KINDS, poses.RMS]
    assert rows["as it is"]["right poses left out"] == "0 of 12"
    assert rows[poses.SWAP]["wrong poses left out (95 %)"]["trials"] == 2
