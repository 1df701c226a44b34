"""Single values that beat the file: ``--set KEY=VALUE`` and the like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.settings.faults import Location
from panoloc_mcl.robot.settings.validation import parse_yaml


@dataclass(frozen=True)
class Override:
    """One value, and where it came from.

    Parameters
    ----------
    key : str
        Dotted.
    value : object
        As YAML would give it.
    source : str
        What the user wrote, to be named in a fault.
    """

    key: str
    value: Any
    source: str

    @property
    def path(self) -> tuple[str, ...]:
        """The parts of the key."""
        return tuple(self.key.split("."))


def parse_override(text: str) -> Override:
    """Read ``KEY=VALUE``, a dotted key and a YAML value.

    Raises
    ------
    ConfigError
        Another form, or a value that is not YAML.
    """
    key, separator, value = text.partition("=")
    key = key.strip()
    if not separator or not all(key.split(".")):
        raise ConfigError(f"--set {text}: needs the form KEY=VALUE; for instance seed=1 or localizer.mode=monte_carlo")
    return Override(key, parse_yaml(value, f"--set {text}", locate=False), f"--set {text}")


def parse_overrides(texts: Sequence[str | Override]) -> list[Override]:
    """Read several, and name every one that is faulty.

    Raises
    ------
    ConfigError
    """
    overrides: list[Override] = []
    faults: list[str] = []
    for text in texts:
        try:
            overrides.append(parse_override(text) if isinstance(text, str) else text)
        except ConfigError as error:
            faults.extend(error.faults)
    if faults:
        raise ConfigError(faults)
    return overrides


def apply(data: dict[str, Any], override: Override) -> None:
    """Put the value into nested data, making the mappings on the way."""
    *parents, last = override.path
    node = data
    for part in parents:
        child = node.get(part)
        if not isinstance(child, dict):
            # A scalar (initial: uniform) gives way to the mapping that a dotted key asks for.
            child = node[part] = {}
        node = child
    node[last] = override.value


def source_at(location: Location, overrides: Sequence[Override], otherwise: str) -> str:
    """Who wrote the value at a location: the last override that set it or a part of it, or else the file."""
    for override in reversed(overrides):
        shared = min(len(override.path), len(location))
        if shared and override.path[:shared] == tuple(str(part) for part in location[:shared]):
            return override.source
    return otherwise
