"""What is wrong with a piece of data, in lines a user can act on: where, key, value, what is allowed, remedy."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from panoloc_mcl.robot.errors import did_you_mean

Location = tuple[str | int, ...]
#: What to call the origin of the value at a location: a file, or ``--set …``.
SourceOf = Callable[[Location], str]

# What to do about each kind of fault that pydantic finds, by the whole name of the kind or by its first word.
_REMEDIES = {
    "bool": "write true or false",
    "finite": "write a plain number",
    "float": "write a number",
    "greater": "raise it",
    "int": "write a whole number",
    "less": "lower it",
    "list": "write a list such as [a, b]",
    "literal": "write it so",
    "model": "write key: value lines below it",
    "path": "write a path",
    "string": "write text, in quotes if need be",
    "string_pattern_mismatch": "use other characters",
    "string_too_long": "shorten it",
    "string_too_short": "fill it in",
    "tuple": "write a list of values",
    "too": "write as many as are asked for",
}
_WORDINGS = {
    "model_type": "must be a mapping of keys to values",
    "list_type": "must be a list",
    "path_type": "must be a path",
    "tuple_type": "must be a list",
}


@dataclass(frozen=True)
class _Fault:
    location: Location
    kind: str
    value: Any
    message: str
    suggestion: str


def fault_lines(model: type[BaseModel], data: Mapping[str, Any], error: ValidationError, source: SourceOf) -> Iterator[str]:
    """One line for each thing that is wrong, none twice.

    Parameters
    ----------
    model : type
        That the data was checked against; its fields are what a wrong key is compared with.
    data : mapping
        As it was given.
    error : ValidationError
    source : callable
        Names the origin of the value at a location.
    """
    for fault in _without_noise([_from_pydantic(model, data, entry) for entry in error.errors()]):
        key = ".".join(str(part) for part in fault.location)
        if fault.kind == "extra_forbidden":
            yield f"{source(fault.location)}: unknown key '{key}'{_nearest_key(model, fault.location)}"
        elif fault.kind == "missing":
            # Whoever wrote the rest of the mapping left it out.
            yield f"{source(fault.location[:-1])}: key '{key}' is missing; add it"
        elif fault.kind == "invalid_key":
            yield f"{source(fault.location)}: key {key} is not text; write a name, or put it in quotes"
        elif fault.location:
            yield f"{source(fault.location)}: {key} = {_shown(fault.value)}: {fault.message}; {fault.suggestion}"
        else:
            yield f"{source(fault.location)}: {fault.message}; {fault.suggestion}"


def _from_pydantic(model: type[BaseModel], data: Mapping[str, Any], entry: Mapping[str, Any]) -> _Fault:
    kind, value = str(entry["type"]), entry["input"]
    location = _in_data(entry["loc"], kind, data)
    message, _, remedy = _worded(kind, str(entry["msg"])).partition("; ")
    if kind == "literal_error":
        allowed = re.findall(r"'([^']*)'", str(entry["ctx"]["expected"]))
        remedy = did_you_mean(value, allowed) or _REMEDIES["literal"]
    elif kind == "list_type" and isinstance(value, str | int):
        remedy = f"write a list: [{value}]"
    elif kind == "model_type":
        keys = sorted(_known_keys(model, location))
        remedy = f"{_REMEDIES['model']} ({', '.join(keys)})" if keys else _REMEDIES["model"]
    general = _REMEDIES.get(kind) or _REMEDIES.get(kind.split("_")[0], "correct it")
    return _Fault(location, kind, value, message, remedy or general)


def _worded(kind: str, message: str) -> str:
    if kind in _WORDINGS:
        return _WORDINGS[kind]
    text = message.removeprefix("Value error, ").removeprefix("Assertion failed, ").replace("; ", ", ", message.count("; ") - 1)
    text = re.sub(r"^(Input|String|Tuple|List) should ", "must ", text)
    # The number that was given stands before the message.
    return re.sub(r"^(must be a valid \w+), .*", r"\1", text)


def _in_data(location: Location, kind: str, data: Any) -> Location:
    """A location without the names of the branches of unions that pydantic puts between the keys."""
    found: list[str | int] = []
    node = data
    for index, part in enumerate(location):
        known: Any = node if isinstance(node, Mapping) else range(len(node)) if isinstance(node, list | tuple) else ()
        if part in known:
            node = node[part]
            found.append(part)
        elif kind == "missing" and index == len(location) - 1:
            found.append(part)
    return tuple(found)


def _without_noise(faults: list[_Fault]) -> list[_Fault]:
    """Each value is tried on every branch of a union: keep the faults of the branch that was meant, join the rest."""
    kept: dict[Location, _Fault] = {}
    ordered: list[_Fault] = []
    for fault in faults:
        deeper = any(
            len(other.location) > len(fault.location) and other.location[: len(fault.location)] == fault.location
            for other in faults
        )
        if deeper:
            continue
        first = kept.get(fault.location)
        if first is None:
            kept[fault.location] = fault
            ordered.append(fault)
        elif fault.message != first.message:
            joined = _Fault(
                first.location,
                first.kind,
                first.value,
                f"{first.message} or {fault.message.removeprefix('must be ')}",
                first.suggestion if first.suggestion != _REMEDIES["literal"] else fault.suggestion,
            )
            ordered[ordered.index(first)] = kept[fault.location] = joined
    return ordered


def _shown(value: object) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _nearest_key(model: type[BaseModel], location: Location) -> str:
    names = _known_keys(model, location[:-1])
    known = f"known keys here: {', '.join(sorted(names))}" if names else "remove it"
    return f"; {did_you_mean(location[-1], names) or known}"


def _known_keys(model: type[BaseModel], path: Location) -> set[str]:
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
