import pytest

from panoloc_mcl.robot.errors import ConfigError


@pytest.fixture
def write(tmp_path):
    """Write a configuration file."""

    def make(text, name="run.yaml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return make


@pytest.fixture
def faults(write):
    """The faults of a configuration text with overrides, the folder cut off; and each is one line."""
    from panoloc_mcl import load_config

    def find(text, *overrides):
        with pytest.raises(ConfigError) as caught:
            load_config(write(text), overrides)
        lines = [fault.replace(str(write(text).parent) + "/", "") for fault in caught.value.faults]
        assert all("\n" not in line for line in lines)
        return lines

    return find
