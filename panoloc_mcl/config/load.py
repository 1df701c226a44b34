"""From a YAML file and ``--set`` overrides to a checked `RunConfig`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from panoloc_mcl.config.model import RunConfig
from panoloc_mcl.config.validation import dump_yaml, parse_yaml, read_yaml, validate
from panoloc_mcl.errors import ConfigError


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> RunConfig:
    """Read a run configuration.

    Parameters
    ----------
    path : str or Path
        YAML file.
    overrides : sequence of str
        ``KEY=VALUE`` with a dotted key and a YAML value, applied in order; they beat the file.

    Raises
    ------
    ConfigError
        With every fault found, one line each.
    """
    path = Path(path)
    data = read_yaml(path)
    sources = [str(path), *(f"--set {text}" for text in overrides)]
    for text in overrides:
        _apply(data, text)
    return validate(RunConfig, data, sources[0] if not overrides else f"{sources[0]} with --set")


def config_from_mapping(data: dict[str, Any], source: str = "configuration") -> RunConfig:
    """Check a configuration given as plain data, for callers that have no file."""
    return validate(RunConfig, data, source)


def config_to_yaml(config: RunConfig) -> str:
    """The resolved configuration as YAML; reading it again gives the same configuration."""
    return dump_yaml(config.model_dump(mode="json"))


def _apply(data: dict[str, Any], text: str) -> None:
    key, separator, value_text = text.partition("=")
    parts = key.strip().split(".")
    if not separator or not all(parts):
        raise ConfigError(f"--set {text}: needs the form KEY=VALUE, for instance seed=1 or localizer.mode=monte_carlo")
    value = parse_yaml(value_text, f"--set {key.strip()}")
    node = data
    for part in parts[:-1]:
        child = node.setdefault(part, {})
        if child is None:
            child = node[part] = {}
        if not isinstance(child, dict):
            # A scalar (initial: uniform) gives way to the mapping that a dotted key asks for.
            child = node[part] = {}
        node = child
    node[parts[-1]] = value
