"""The reference of all parameters, generated from the model: ``python -m panoloc_mcl.tools.config.reference > CONFIGURATION.md``."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from panoloc_mcl.tools.config.model import RunConfig

_HEAD = """\
# Configuration

Every key of a run configuration. A configuration is a YAML file with any of them; what it leaves out has its default.
On the command line the same keys are dotted: `--set localizer.monte_carlo.particles=5000`. The command line beats the
file. Unknown keys, values out of range, `.nan` and `.inf` are refused, all at once; `panoloc check` only looks.

This file is generated: `python -m panoloc_mcl.tools.config.reference > CONFIGURATION.md`.
"""
_UNIT = re.compile(r", (m|s|m/s|m/m|m/rad|rad/m|rad/rad|degrees|degrees/s|radians|pixels)(?=[.,;: ])")
_NAMES = {bool: "true, false", int: "whole number", float: "number", str: "text", Path: "path", NoneType: "null"}


def parameter_reference() -> str:
    """The text of ``CONFIGURATION.md``."""
    return "\n".join([_HEAD, *_sections(RunConfig, "")])


def units_of(field: FieldInfo) -> str:
    """The unit that a description names, or nothing."""
    found = _UNIT.search(field.description or "")
    return found[1] if found else ""


def _sections(model: type[BaseModel], prefix: str) -> Iterator[str]:
    """The section of a model, then those of the models in it."""
    plain = {name: field for name, field in model.model_fields.items() if _only_model(field.annotation) is None}
    yield f"## {f'`{prefix}`' if prefix else 'The run'}\n"
    yield f"{_first_line(model)}\n"
    if plain:
        yield "| key | values | unit | default | range | effect |"
        yield "|---|---|---|---|---|---|"
        for name, field in plain.items():
            yield _row(_dotted(prefix, name), field)
        yield ""
    for name, field in model.model_fields.items():
        for inner in _models_in(field.annotation):
            yield from _sections(inner, _dotted(prefix, name))


def _row(key: str, field: FieldInfo) -> str:
    cells = (f"`{key}`", _values(field.annotation), units_of(field), _default(field), _range(field), field.description or "")
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _values(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _values(arguments[0])
    if origin in (Union, UnionType):
        return " or ".join(_values(argument) for argument in arguments)
    if origin is Literal:
        return ", ".join(f"`{value}`" for value in arguments)
    if origin is list:
        return f"list of {_values(arguments[0])}"
    if origin is tuple:
        return f"list of {len(arguments)}: {', '.join(_values(argument) for argument in arguments)}"
    return "a mapping, see below" if issubclass(annotation, BaseModel) else _NAMES[annotation]


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=False)
    if value is PydanticUndefined:
        return "must be given"
    if value is None or isinstance(value, bool):
        return f"`{'null' if value is None else str(value).lower()}`"
    return f"`{value}`"


def _range(field: FieldInfo) -> str:
    limits = list(_limits([field.annotation, *field.metadata]))
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<", "min_length": "length ≥", "max_length": "length ≤"}
    texts = []
    for name, sign in signs.items():
        # The limit that stands on the field itself comes last and holds.
        values = [value for limit, value in limits if limit == name]
        if values:
            texts.append(f"{sign} {_number(values[-1])}")
    return ", ".join(texts)


def _limits(parts: list[Any]) -> Iterator[tuple[str, Any]]:
    for part in parts:
        if get_origin(part) in (Annotated, Union, UnionType):
            yield from _limits(list(get_args(part)))
        elif isinstance(part, FieldInfo):
            yield from _limits(list(part.metadata))
        elif not isinstance(part, type) and get_origin(part) is None:
            for name in ("ge", "gt", "le", "lt", "min_length", "max_length"):
                value = getattr(part, name, None)
                if value is not None:
                    yield name, value


def _number(value: float) -> str:
    return "2^63" if value == 2**63 else f"{value:g}" if abs(value) < 1e5 else f"{value:.0f}"


def _only_model(annotation: Any) -> type[BaseModel] | None:
    return annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else None


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    found = _only_model(annotation)
    if found is not None:
        return [found]
    return [inner for argument in get_args(annotation) for inner in _models_in(argument)]


def _dotted(prefix: str, name: str) -> str:
    return f"{prefix}.{name}" if prefix else name


def _first_line(model: type[BaseModel]) -> str:
    return " ".join((model.__doc__ or "").split("\n\n")[0].split())


if __name__ == "__main__":
    sys.stdout.write(parameter_reference())
