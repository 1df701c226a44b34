from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoloc_mcl import load_config
from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.tools.config import Override, config_from_mapping, config_to_yaml, dataset_in
from panoloc_mcl.tools.config.model import RunConfig

CONFIGS = Path(__file__).parents[3] / "configs"


def test_an_empty_file_is_all_defaults(write):
    assert load_config(write("")) == RunConfig()
    assert load_config(write("# nothing yet\n")) == RunConfig()


def test_the_command_line_beats_the_file_and_later_beats_earlier(write):
    path = write("seed: 1\nruns: 2\n")
    config = load_config(path, ["seed=5", "seed=6"])
    assert (config.seed, config.runs) == (6, 2)


def test_values_on_the_command_line_are_yaml(write):
    path = write("")
    config = load_config(path, ["sequences=[noon_00, 'evening_*']", "map=null", "localizer.gate.distance_m=1e-1"])
    assert config.sequences == ["noon_00", "evening_*"]
    assert config.map.file is None
    assert config.localizer.gate.distance_m == 0.1


def test_a_value_may_hold_an_equals_sign(write):
    assert load_config(write(""), ["dataset=a=b"]).dataset == "a=b"


@pytest.mark.parametrize("text", ["localizer:\n", "localizer: {initial: uniform}\n", ""])
def test_a_dotted_key_makes_the_mappings_it_needs(write, text):
    overrides = [f"localizer.initial.{key}={value}" for key, value in (("x", 1), ("y", 2), ("heading_deg", 90))]
    initial = load_config(write(text), overrides).localizer.initial
    assert (initial.x, initial.y, initial.heading_deg, initial.sd_position_m) == (1.0, 2.0, 90.0, 0.2)


def test_an_override_of_its_own_option_is_no_yaml(write):
    assert load_config(write(""), [Override("out", "[a]", "--out [a]")]).out == Path("[a]")


def test_seed_zero_is_a_seed(write):
    assert load_config(write("seed: 3\n"), ["seed=0"]).seed == 0


RUNS = [path for path in sorted(CONFIGS.glob("*.yaml")) if not path.stem.startswith(("compare_", "simulate_", "live"))]


@pytest.mark.parametrize("path", RUNS, ids=lambda path: path.stem)
def test_the_resolved_configuration_reads_back_the_same(path, write):
    config = load_config(path)
    assert config.name == path.stem
    assert load_config(write(config_to_yaml(config))) == config


def test_all_promised_configurations_are_there():
    assert {"global", "track", "kidnap", "kalman", "paper"} <= {path.stem for path in CONFIGS.glob("*.yaml")}


def test_the_data_set_of_a_faulty_configuration_is_still_found(write):
    assert dataset_in(write("datset: a\n")) == "hall"
    assert dataset_in(write("dataset: a\nruns: 0\n")) == "a"
    assert dataset_in(write("dataset: a\n"), ["dataset=b"]) == "b"
    assert dataset_in(write("dataset: [a]\n")) is None


def test_plain_data_needs_no_file():
    assert config_from_mapping({"seed": 4}).seed == 4
    with pytest.raises(ConfigError, match="configuration: unknown key 'sed'; did you mean 'seed'"):
        config_from_mapping({"sed": 4})


SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
KEYS = st.text(max_size=8) | st.sampled_from(sorted(RunConfig.model_fields))


@given(st.dictionaries(KEYS, SCALARS | st.lists(SCALARS, max_size=3) | st.dictionaries(KEYS, SCALARS, max_size=3), max_size=5))
def test_whatever_the_data_it_is_a_config_or_its_faults(data):
    try:
        config_from_mapping(data)
        return
    except ConfigError as error:
        faults = error.faults
    assert faults
    assert all(fault.startswith("configuration: ") and "\n" not in fault for fault in faults)


def test_a_map_is_named_by_its_path_alone_or_with_how_it_is_made(write):
    assert load_config(write("map: hall.panomap\n")).map.file == Path("hall.panomap")
    assert load_config(write(""), ["map=hall.panomap"]).map.file == Path("hall.panomap")
    config = load_config(write("map: {mend: false, sd_xy_m: 0.05}\n"))
    assert config.map.file is None
    assert not config.map.mend
    assert config.map.sd_xy_m == 0.05
