"""Drives written in the layouts that recordings come in: to ask whether they are read again as what they were."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from panoloc_mcl.laboratory.layouts.bags import write_mcap, write_ros1, write_ros2
from panoloc_mcl.laboratory.layouts.files import write_cold, write_folder, write_video
from panoloc_mcl.tools.datasets import Sequence

__all__ = ["LAYOUTS", "Layout"]


@dataclass(frozen=True)
class Layout:
    """How a drive is written.

    Parameters
    ----------
    write : callable
        Takes a drive, and where it goes to without an ending; gives the file or folder.
    lossless : bool
        Whether images come out of it to the last bit.
    """

    write: Callable[[Sequence, Path], Path]
    lossless: bool = True


#: By name. PNG and FFV1 keep every bit, JPEG and H.264 do not.
LAYOUTS: dict[str, Layout] = {
    "ros1": Layout(partial(write_ros1, images="raw")),
    "ros1-lz4": Layout(partial(write_ros1, images="raw", compression="lz4")),
    "ros2-sqlite3": Layout(partial(write_ros2, images="raw", storage="sqlite3")),
    "ros2-sqlite3-zstd": Layout(partial(write_ros2, images="raw", storage="sqlite3", zstd="message")),
    "ros2-mcap": Layout(partial(write_ros2, images="raw", storage="mcap")),
    "ros2-mcap-png": Layout(partial(write_ros2, images=".png", storage="mcap")),
    "mcap": Layout(partial(write_mcap, images="raw", compression="none")),
    "mcap-zstd": Layout(partial(write_mcap, images="raw", compression="zstd")),
    "mcap-png": Layout(partial(write_mcap, images=".png", compression="zstd")),
    "cold": Layout(partial(write_cold, ending=".png")),
    "video": Layout(partial(write_video, ending=".mkv", codec="ffv1", odometry="csv")),
    "folder": Layout(write_folder),
    "ros1-jpeg": Layout(partial(write_ros1, images=".jpg"), lossless=False),
    "mcap-jpeg": Layout(partial(write_mcap, images=".jpg", compression="none"), lossless=False),
    "cold-jpeg": Layout(partial(write_cold, ending=".jpeg"), lossless=False),
    "video-h264": Layout(partial(write_video, ending=".mp4", codec="libx264", odometry="csv"), lossless=False),
}
