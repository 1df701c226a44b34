"""Run configuration and the reading of YAML."""

from panoloc_mcl.config.load import config_from_mapping, config_to_yaml, load_config
from panoloc_mcl.config.model import RunConfig

__all__ = ["RunConfig", "config_from_mapping", "config_to_yaml", "load_config"]
