from pathlib import Path

import pytest

from panoloc_mcl.laboratory.comparison.matrix import is_matrix, load_matrix, matrix_from_mapping
from panoloc_mcl.robot.errors import ConfigError

CONFIGS = Path(__file__).parents[3] / "configs"


def faults(data):
    with pytest.raises(ConfigError) as error:
        matrix_from_mapping(data, "m.yaml")
    return list(error.value.faults)


def test_cells_are_the_product_of_the_axes_seeds_last(plan_of):
    plan = plan_of(
        corruptions=["clean", "bars:0.5"],
        references=["all", "fourth"],
        modes=["monte_carlo", "kalman_orientation"],
        variants={"few": {"localizer.monte_carlo.particles": 100}, "many": {"localizer.monte_carlo.particles": 300}},
        seeds=[3, 8],
    )
    assert len(plan.cells) == 2 * 2 * 2 * 2 * 2 * 2
    first, second = plan.cells[:2]
    assert first.axes == {
        "dataset": "room",
        "light": "noon",
        "corruption": "clean",
        "references": "all",
        "observation": "votes",
        "mode": "monte_carlo",
        "variant": "few",
        "seed": 3,
    }
    assert (second.seed, second.config.seed) == (8, 8)
    assert first.config.localizer.monte_carlo.particles == 100
    assert first.config.sequences == ["noon_00"]
    assert first.config.runs == 1


def test_names_of_ones_own_stand_for_settings(plan_of):
    plan = plan_of(
        observations={"sharp": {"model": "votes", "votes": {"vote_width": 0.3}}, "paper": {}},
        modes={"tracking": {"mode": "kalman_orientation", "initial": {"x": 1.0, "y": 1.0, "heading_deg": 20.0}}},
        seeds=1,
    )
    sharp, paper = (cell.config for cell in plan.cells)
    assert (sharp.observation.model, sharp.observation.votes.vote_width) == ("votes", 0.3)
    assert not sharp.observation.votes.virtual_places.enabled
    assert paper.observation.model == "paper"
    assert paper.localizer.initial.heading_deg == 20.0


def test_a_number_of_seeds_counts_from_that_of_the_base(plan_of):
    assert [cell.seed for cell in plan_of(base={"seed": 5}, observations=["votes"], seeds=3).cells] == [5, 6, 7]


def test_every_mistake_is_named_with_what_was_meant(data):
    assert faults(data | {"observation": ["votes"], "seeds": 0}) == [
        "m.yaml: seeds = 0: must be greater than or equal to 1 or a list; raise it",
        "m.yaml: unknown key 'observation'; did you mean 'observations'?",
    ]
    (unknown,) = faults(data | {"observations": ["vote"]})
    assert unknown.startswith("m.yaml: observations.vote: observation.model = 'vote': must be 'votes', ")
    assert unknown.endswith("did you mean 'votes'?")
    assert faults(data | {"variants": {"x": {"localizer.monte_carlo.partikles": 5}}}) == [
        "m.yaml: variants.x: unknown key 'localizer.monte_carlo.partikles'; did you mean 'particles'?"
    ]
    assert faults(data | {"corruptions": ["clean", "barz:0.5"], "references": ["half"]}) == [
        "m.yaml: corruptions: corruption 'barz:0.5': unknown corruption 'barz'; did you mean 'bars'?",
        "m.yaml: references: references: half: no such part; use all, checkerboard (every second of a grid), fourth (every fourth), "
        "or a distance like every-2m",
    ]
    assert faults(data | {"base": {"dataset": "room"}}) == ["m.yaml: base: key 'dataset' has no place here; use datasets"]
    assert faults(data | {"seeds": [1, 2, 1]}) == ["m.yaml: seeds: '1' is given twice; drop one"]


@pytest.mark.parametrize("axis", ["datasets", "lights", "corruptions", "references", "observations", "modes", "seeds"])
def test_an_empty_axis_is_one_line(data, axis):
    (fault,) = faults(data | {axis: []})
    assert fault.startswith(f"m.yaml: {axis} = []")


def test_a_light_that_there_is_not(plan_of):
    with pytest.raises(ConfigError, match=r"lights: 'midnight' fits no group of sequences; there are: noon$"):
        plan_of(lights=["midnight"])


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_shipped_matrices_are_good(path):
    assert is_matrix(path) == path.stem.startswith("compare_")
    if is_matrix(path):
        matrix = load_matrix(path)
        assert matrix.name == path.stem
        assert matrix.baseline is not None
