"""Reading and checking of YAML: every fault at once, one line each, with file, key, value and remedy.

The only place in the package that parses YAML.
"""

from __future__ import annotations

import difflib
from collections.abc import Hashable, Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from panoloc_mcl.errors import ConfigError


class StrictModel(BaseModel):
    """Base of everything that is read from YAML: no unknown keys, no NaN or infinity, immutable once read."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, validate_default=True)


Model = TypeVar("Model", bound=StrictModel)


class _UniqueKeyLoader(yaml.SafeLoader):
    """SafeLoader that refuses a key given twice, where plain YAML would silently let the last one win."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                raise yaml.constructor.ConstructorError(None, None, "a key must be plain text", key_node.start_mark)
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is given twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def parse_yaml(text: str, source: str) -> Any:
    """Parse YAML text safely.

    Raises
    ------
    ConfigError
        Not YAML, or a key given twice; the line and the column are named.
    """
    try:
        return yaml.load(text, Loader=_UniqueKeyLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{source}:{mark.line + 1}:{mark.column + 1}" if mark is not None else source
        problem = getattr(error, "problem", None) or str(error)
        raise ConfigError(f"{where}: not valid YAML: {problem}; mend this line") from error


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping.

    Raises
    ------
    ConfigError
        Missing or unreadable file, not YAML, or not a mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; check the path") from None
    except IsADirectoryError:
        raise ConfigError(f"{path}: is a folder; name the YAML file in it") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read ({error}); check permissions and encoding (UTF-8)") from error
    data = parse_yaml(text, str(path))
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: holds a {type(data).__name__} where a mapping (key: value lines) is needed")
    return data


def dump_yaml(data: Mapping[str, Any]) -> str:
    """YAML text of plain data, keys in the given order."""
    return yaml.safe_dump(dict(data), sort_keys=False, allow_unicode=True, width=120)


def validate(model: type[Model], data: Mapping[str, Any], source: str) -> Model:
    """Check plain data against a model.

    Parameters
    ----------
    model : subclass of StrictModel
    data : mapping
        As read from YAML.
    source : str
        What to call the data in a fault: a file, or ``--set``.

    Raises
    ------
    ConfigError
        Every fault found, one line each: key, value, what is allowed; unknown keys with the nearest known one.
    """
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        raise ConfigError(_fault_lines(model, error, source)) from error


def _fault_lines(model: type[BaseModel], error: ValidationError, source: str) -> Iterator[str]:
    seen: set[str] = set()
    for fault in error.errors():
        location = [part for part in fault["loc"] if not _is_union_tag(part)]
        key = ".".join(str(part) for part in location)
        kind, value = fault["type"], fault["input"]
        if kind == "extra_forbidden":
            line = f"{source}: unknown key '{key}'{_did_you_mean(model, location)}"
        elif kind == "missing":
            line = f"{source}: key '{key}' is missing; add it"
        elif key:
            line = f"{source}: {key} = {_shown(value)}: {_plain(fault['msg'])}"
        else:
            line = f"{source}: {_plain(fault['msg'])}"
        if line not in seen:
            seen.add(line)
            yield line


def _is_union_tag(part: object) -> bool:
    # pydantic puts the name of the tried branch of a union into the location; keys of ours are snake_case.
    return isinstance(part, str) and (not part.isidentifier() or part[:1].isupper() or part in {"str", "float", "int"})


def _plain(message: str) -> str:
    text = message.removeprefix("Value error, ").removeprefix("Assertion failed, ")
    return text.replace("Input should be", "must be")


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _did_you_mean(model: type[BaseModel], location: list[Any]) -> str:
    names = _known_keys(model, location[:-1])
    close = difflib.get_close_matches(str(location[-1]), names, n=1, cutoff=0.5)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; known keys here: {', '.join(sorted(names))}" if names else "; remove it"


def _known_keys(model: type[BaseModel], path: list[Any]) -> set[str]:
    models = [model]
    for step in path:
        found: list[type[BaseModel]] = []
        for candidate in models:
            field = candidate.model_fields.get(str(step))
            found.extend(_models_in(field.annotation) if field else ())
        # An index into a list or an unknown step keeps the models at hand.
        models = found or models
    return {name for candidate in models for name in candidate.model_fields}


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Union, UnionType, list, tuple, dict) or get_args(annotation):
        return [found for argument in get_args(annotation) for found in _models_in(argument)]
    return []
