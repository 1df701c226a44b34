"""Reading and checking of YAML: every fault at once, one line each, with file, key, value and remedy.

The only place in the package that parses YAML.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from panoloc_mcl.robot.errors import ConfigError
from panoloc_mcl.robot.settings.faults import SourceOf, fault_lines


class StrictModel(BaseModel):
    """Base of everything that is read from YAML: no unknown keys, no NaN or infinity, immutable once read."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True, validate_default=True)

    @field_validator("*", mode="before")
    @classmethod
    def _truth_values_only_where_asked_for(cls, value: Any, info: ValidationInfo) -> Any:
        # Otherwise true would count as 1.
        if isinstance(value, bool) and not _takes_bool(cls.model_fields[str(info.field_name)].annotation):
            raise ValueError("must not be true or false; mind that YAML reads yes, no, on and off so")
        return value


def _takes_bool(annotation: Any) -> bool:
    return annotation is bool or any(_takes_bool(argument) for argument in get_args(annotation))


Model = TypeVar("Model", bound=StrictModel)


# Of a file that people write: more is an accident, or meant to do harm.
_CHARACTERS_A_VALUE, _DEEPEST, _MOST_VALUES = 50, 40, 20_000


class _UniqueKeyLoader(yaml.SafeLoader):
    """SafeLoader with the numbers of YAML 1.2, that refuses a key given twice, where plain YAML would silently let the last one win.

    In YAML 1.1 a leading zero made a number octal and a colon one to the base of 60: 010 was 8, and 1:30 was 90.
    """

    yaml_implicit_resolvers = {  # noqa: RUF012 as PyYAML has it
        first: [(tag, regexp) for tag, regexp in resolvers if tag.rpartition(":")[2] not in ("int", "float", "merge")]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if key_node.value == "<<" and isinstance(key_node, yaml.ScalarNode) and key_node.style is None:
                problem = "merge keys (<<) are not part of YAML 1.2, write the keys themselves"
                raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                raise yaml.constructor.ConstructorError(None, None, "a key must be plain text", key_node.start_mark)
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is given twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def _whole_number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    text = str(loader.construct_scalar(node)).replace("_", "")
    sign, digits = (text[:1], text[1:]) if text[:1] in "+-" else ("", text)
    return int(sign + digits, 16 if digits[:2] == "0x" else 10)


_UniqueKeyLoader.add_implicit_resolver(
    "tag:yaml.org,2002:int", re.compile(r"[-+]?(0x[0-9a-fA-F]+|[0-9][0-9_]*)\Z"), list("-+0123456789")
)
_UniqueKeyLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"([-+]?([0-9][0-9_]*)\.[0-9_]*([eE][-+][0-9]+)?|\.[0-9][0-9_]*([eE][-+][0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))\Z"
    ),
    list("-+0123456789."),
)
_UniqueKeyLoader.add_constructor("tag:yaml.org,2002:int", _whole_number)


class _Dumper(yaml.SafeDumper):
    """Puts in quotes what the loader above would read as something else than text."""

    yaml_implicit_resolvers = {  # noqa: RUF012 as PyYAML has it
        **_UniqueKeyLoader.yaml_implicit_resolvers,
        # A key that is called so is text, and no merge key.
        "<": yaml.SafeLoader.yaml_implicit_resolvers["<"],
    }


def _check_size(text: str, most_values: int) -> None:
    """Refuse what would take the time or the memory of the machine, before anything is made of it.

    Raises
    ------
    YAMLError
        Too long, too deep, or with aliases that stand for too much.
    """

    def refuse(problem: str, mark: Any = None) -> NoReturn:
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)

    longest = _CHARACTERS_A_VALUE * most_values
    if len(text) > longest:
        refuse(f"{len(text)} characters, at most {longest} are read")
    # Values below each open node, and what each anchor stands for.
    counts: list[int] = [0]
    names: list[str | None] = [None]
    anchors: dict[str, int | None] = {}
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent):
            size = anchors.get(str(event.anchor), 0)
            if size is None:
                refuse(f"alias *{event.anchor} stands inside what it names", event.start_mark)
            counts[-1] += size
        elif isinstance(event, yaml.ScalarEvent):
            counts[-1] += 1
            if event.anchor:
                anchors[event.anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            counts.append(1)
            names.append(event.anchor)
            if event.anchor:
                anchors[event.anchor] = None
            if len(counts) > _DEEPEST:
                refuse(f"more than {_DEEPEST} levels deep", event.start_mark)
        elif isinstance(event, yaml.CollectionEndEvent):
            count, name = counts.pop(), names.pop()
            counts[-1] += count
            if name:
                anchors[name] = count
        if counts[-1] > most_values:
            refuse(f"more than {most_values} values, aliases counted as what they stand for", event.start_mark)


def parse_yaml(text: str, source: str, *, locate: bool = True, most_values: int = _MOST_VALUES) -> Any:
    """Parse YAML text safely.

    Parameters
    ----------
    text : str
    source : str
        What to call it in a fault.
    locate : bool
        Add line and column to that; pointless where the text is but one value.
    most_values : int
        Of more values, or of a text that is very long for so many, nothing is read.

    Raises
    ------
    ConfigError
        Not YAML, or a key given twice.
    """
    try:
        _check_size(text, most_values)
        return yaml.load(text, Loader=_UniqueKeyLoader)
    except (ValueError, OverflowError, RecursionError) as error:
        # Such as a 13th month, or a number of five thousand digits.
        raise ConfigError(f"{source}: not valid YAML: {error}; correct the file there") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{source}:{mark.line + 1}:{mark.column + 1}" if locate and mark is not None else source
        problem = getattr(error, "problem", None) or str(error)
        raise ConfigError(f"{where}: not valid YAML: {problem}; check brackets, colons and indentation") from error


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
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be read ({error}); check permissions and encoding (UTF-8)") from error
    data = parse_yaml(text, str(path))
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: holds a {type(data).__name__} where a mapping is needed; write key: value lines")
    return data


def dump_yaml(data: Mapping[str, Any]) -> str:
    """YAML text of plain data, keys in the given order."""
    text: str = yaml.dump(dict(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
    return text


def kind_tag(value: Any) -> str | None:
    """Which of several models with a ``kind`` is meant, for pydantic's ``Discriminator``."""
    kind = value.get("kind") if isinstance(value, Mapping) else getattr(value, "kind", None)
    # Capitalised: the checker takes capitalised parts of a key for names of alternatives and leaves them out of the fault.
    return kind.capitalize() if isinstance(kind, str) and kind.islower() else None


def validate(model: type[Model], data: Mapping[str, Any], source: str | SourceOf) -> Model:
    """Check plain data against a model.

    Parameters
    ----------
    model : subclass of StrictModel
    data : mapping
        As read from YAML.
    source : str or callable
        What to call the data in a fault: a file, or a function that says whence the value at a location came.

    Raises
    ------
    ConfigError
        Every fault found, one line each: key, value, what is allowed; unknown keys with the nearest known one.
    """
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        source_of = (lambda location: source) if isinstance(source, str) else source
        raise ConfigError(fault_lines(model, data, error, source_of)) from error
