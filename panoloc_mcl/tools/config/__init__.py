"""Run configuration and the reading of YAML."""

from panoloc_mcl.tools.config.load import config_from_mapping, config_to_yaml, dataset_in, load_config
from panoloc_mcl.tools.config.model import RunConfig
from panoloc_mcl.tools.config.overrides import Override

__all__ = ["Override", "RunConfig", "config_from_mapping", "config_to_yaml", "dataset_in", "load_config"]
