"""From a YAML file and overrides to a checked `RunConfig`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from panoloc_mcl.robot.settings.validation import dump_yaml, read_yaml, validate
from panoloc_mcl.tools.config.model import RunConfig
from panoloc_mcl.tools.config.overrides import Override, apply, parse_overrides, source_at


def load_config(path: str | Path, overrides: Sequence[str | Override] = ()) -> RunConfig:
    """Read a run configuration.

    Parameters
    ----------
    path : str or Path
        YAML file.
    overrides : sequence of str or Override
        ``KEY=VALUE`` with a dotted key and a YAML value, applied in order; they beat the file.

    Raises
    ------
    ConfigError
        With every fault found, one line each.
    """
    return _resolve(read_yaml(Path(path)), overrides, str(path))


def config_from_mapping(
    data: dict[str, Any], source: str = "configuration", overrides: Sequence[str | Override] = ()
) -> RunConfig:
    """Check a configuration given as plain data, for callers that have no file."""
    return _resolve(data, overrides, source)


def dataset_in(path: str | Path, overrides: Sequence[str | Override] = ()) -> str | None:
    """The data set that a configuration names, even if the rest of it is faulty; None if that cannot be told.

    Raises
    ------
    ConfigError
        A file or an override that cannot be read at all.
    """
    data = read_yaml(Path(path))
    for override in parse_overrides(overrides):
        apply(data, override)
    named = data.get("dataset", RunConfig.model_fields["dataset"].default)
    return named if isinstance(named, str) and named else None


def config_to_yaml(config: RunConfig) -> str:
    """The resolved configuration as YAML; reading it again gives the same configuration."""
    return dump_yaml(config.model_dump(mode="json"))


def _resolve(data: dict[str, Any], overrides: Sequence[str | Override], source: str) -> RunConfig:
    parsed = parse_overrides(overrides)
    for override in parsed:
        apply(data, override)
    return validate(RunConfig, data, lambda location: source_at(location, parsed, source))
