"""OpenCV's own YAML (``%YAML:1.0``, ``!!opencv-matrix``) as plain numbers, lists and texts.

It is YAML but for its first line. OpenCV's own parser is not asked: damaged files keep it busy for ever, or make it end the process.
"""

from __future__ import annotations

import re
from typing import Any

from panoloc_mcl.robot.errors import CameraError, ConfigError
from panoloc_mcl.robot.settings.validation import parse_yaml

# Many files that people write have no line of dashes, or comments before it.
_HEAD = re.compile(r"\ufeff?%YAML[: ]1\.\d[ \t]*\r?\n(?:(?:[ \t]*(?:#[^\n]*)?\r?\n)*---[ \t]*\r?\n)?")
_TAG = re.compile(r"!!opencv-[a-z-]+")
# OpenCV reads and writes numbers that are none in YAML, such as 1e-3.
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
# Such files also hold what a camera was calibrated with: fifty images of a board with two hundred corners are 20,000 numbers.
_MOST_VALUES = 200_000


def parse_opencv(text: str, source: str) -> dict[str, Any]:
    """All that the file's text holds; matrices as flat lists.

    Raises
    ------
    CameraError
        Not of this format.
    """
    head = _HEAD.match(text)
    body = text if head is None else "\n" * head[0].count("\n") + text[head.end() :]
    if body.startswith(("%", "\ufeff%")):
        raise CameraError(f"{source}: is not valid OpenCV YAML (it begins with neither %YAML:1.0 nor a key); export it again")
    try:
        data = parse_yaml(_TAG.sub("", body), source, most_values=_MOST_VALUES)
        if not isinstance(data, dict):
            raise ValueError("it has no keys")
        return {str(key): _plain(value, str(key)) for key, value in data.items()}
    except ConfigError as error:
        raise CameraError(str(error)) from error
    except ValueError as error:
        raise CameraError(f"{source}: is not valid OpenCV YAML ({error}); export it again") from error


def _plain(value: Any, name: str) -> Any:
    if isinstance(value, dict):
        if {"rows", "cols", "data"} <= set(value):
            return _matrix(value, name)
        return {str(key): _plain(each, f"{name}.{key}") for key, each in value.items()}
    if isinstance(value, list):
        return [_plain(each, name) for each in value]
    if isinstance(value, str):
        return float(value) if _NUMBER.fullmatch(value) else value
    return float(value) if isinstance(value, int) else value


def _matrix(node: dict[Any, Any], name: str) -> list[Any]:
    """The numbers of a matrix, row by row; ``dt`` gives how many channels each element has (``2f``)."""
    rows, columns, numbers = node["rows"], node["cols"], _plain(node["data"], name)
    element = re.fullmatch(r"(\d{0,3})[ucwsifdh]", str(node.get("dt", "d")))
    whole = isinstance(rows, int) and isinstance(columns, int) and isinstance(numbers, list)
    if element is None or not whole or rows * columns * int(element[1] or 1) != len(numbers):
        raise ValueError(f"matrix {name} does not hold what its rows and cols say")
    return list(numbers)
