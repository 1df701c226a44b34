"""OpenCV's own YAML (``%YAML:1.0``, ``!!opencv-matrix``) as plain numbers, lists and texts, read by OpenCV itself."""

from __future__ import annotations

import re
from typing import Any

import cv2

from panoloc_mcl.robot.errors import CameraError

# OpenCV's parser runs on for ever over a head line that it does not know, so it is given a head of our own.
# Many files that people write have no line of dashes, or comments before it.
_HEAD = re.compile(r"\ufeff?%YAML[: ]1\.\d[ \t]*\r?\n(?:(?:[ \t]*(?:#[^\n]*)?\r?\n)*---[ \t]*\r?\n)?")


def parse_opencv(text: str, source: str) -> dict[str, Any]:
    """All that the file's text holds; matrices as flat lists.

    Raises
    ------
    CameraError
        Not of this format.
    """
    body = _HEAD.sub("", text, count=1) if _HEAD.match(text) else text
    if body.startswith(("%", "\ufeff%")):
        raise CameraError(f"{source}: is not valid OpenCV YAML (it begins with neither %YAML:1.0 nor a key); export it again")
    try:
        storage = cv2.FileStorage("%YAML:1.0\n---\n" + body, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        return {key: _plain(root.getNode(key)) for key in root.keys()}  # noqa: SIM118
    except (cv2.error, SystemError, ValueError) as error:
        raise CameraError(f"{source}: is not valid OpenCV YAML ({str(error).splitlines()[0]}); export it again") from error


def _plain(node: Any) -> Any:
    if node.isMap():
        keys = node.keys()
        if {"rows", "cols", "data"} <= set(keys):
            matrix = node.mat()
            if matrix is None:
                raise ValueError(f"matrix {node.name()} does not hold what its rows and cols say")
            return matrix.ravel().tolist()
        return {key: _plain(node.getNode(key)) for key in keys}
    if node.isSeq():
        return [_plain(node.at(index)) for index in range(node.size())]
    if node.isString():
        return node.string()
    return node.real() if node.isInt() or node.isReal() else None
