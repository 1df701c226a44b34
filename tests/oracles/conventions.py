"""Data sets that are written in another convention, made from good ones: images are changed in files, poses in memory."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from panoloc_mcl.robot.images import read_image, write_image
from panoloc_mcl.tools.datasets import Trajectory


def turned(references, folder: Path, seed: int):
    """References at headings of their own: panoramas rolled by whole columns, clockwise."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    width = references.image_size[0]
    files, poses = [], references.poses.copy()
    for index, file in enumerate(references.files):
        columns = int(rng.integers(width))
        # At heading t the world's azimuth 0 lies t to the right of the middle of the view, that is in a column further on.
        image = np.roll(read_image(file), columns, axis=1)
        poses[index, 2] += 2.0 * np.pi * columns / width
        files.append(folder / f"{index:03}.png")
        write_image(files[-1], image)
    return replace(
        references, files=tuple(files), poses=np.column_stack([poses[:, :2], (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi])
    )


def changed(images, folder: Path, change):
    """The same references or drive with changed images."""
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for index, file in enumerate(images.files):
        files.append(folder / f"{index:03}.png")
        if not files[-1].exists():
            write_image(files[-1], np.ascontiguousarray(change(read_image(file))))
    return replace(images, files=tuple(files))


def with_poses(references, change):
    return replace(references, poses=np.ascontiguousarray(change(references.poses.copy())))


def with_camera(images, **values):
    return replace(images, camera=images.camera.model_copy(update=values))


def with_odometry(drive, change, later: float = 0.0):
    odometry = drive.odometry
    return replace(drive, odometry=Trajectory(odometry.times + later, np.ascontiguousarray(change(odometry.poses.copy()))))


def same(poses):
    return poses


def degrees(poses):
    return np.column_stack([poses[:, :2], np.degrees(poses[:, 2])])


#: Of references at headings of their own: what is done to them, and the kinds that name it rightly.
REFERENCES = {
    "degrees": (lambda r, f: with_poses(r, degrees), {"degrees"}),
    "clockwise": (lambda r, f: with_poses(r, lambda p: p * [1, 1, -1]), {"clockwise"}),
    "clockwise degrees": (lambda r, f: with_poses(r, lambda p: degrees(p) * [1, 1, -1]), {"clockwise degrees"}),
    "swapped": (lambda r, f: with_poses(r, lambda p: p[:, [1, 0, 2]]), {"swapped"}),
    "mirrored y": (lambda r, f: with_poses(r, lambda p: p * [1, -1, 1]), {"mirrored y"}),
    "left-handed": (lambda r, f: with_poses(r, lambda p: p * [1, -1, -1]), {"mirrored"}),
    "images mirrored": (lambda r, f: changed(r, f, lambda i: i[:, ::-1]), {"mirrored"}),
    "columns": (lambda r, f: with_camera(r, columns="counterclockwise"), {"mirrored"}),
    "upside down": (lambda r, f: changed(r, f, lambda i: i[::-1]), {"upside down"}),
    "turned over": (lambda r, f: changed(r, f, lambda i: i[::-1, ::-1]), {"upside down"}),
    "heading 180": (lambda r, f: with_camera(r, heading_column=r.image_size[0] / 2), {"heading off"}),
    "heading 90": (lambda r, f: with_camera(r, heading_column=r.image_size[0] / 4), {"heading off"}),
    "heading -40": (lambda r, f: with_camera(r, heading_column=r.image_size[0] * 8 / 9), {"heading off"}),
    "centimetres": (lambda r, f: with_poses(r, lambda p: p * [100, 100, 1]), {"centimetres"}),
    "millimetres": (lambda r, f: with_poses(r, lambda p: p * [1000, 1000, 1]), {"millimetres"}),
    "height 600": (lambda r, f: with_camera(r, height_m=600.0), {"height"}),
    "height half": (lambda r, f: with_camera(r, height_m=0.3), {"height"}),
}

#: Of drives: what is done to odometry or images, and a word that the line says.
DRIVES = {
    "clockwise": (lambda d, f: with_odometry(d, lambda p: p * [1, 1, -1]), "clockwise"),
    "mirrored": (lambda d, f: with_odometry(d, lambda p: p * [1, -1, -1]), "mirrored"),
    "images mirrored": (lambda d, f: changed(d, f, lambda i: i[:, ::-1]), "mirrored"),
    "degrees": (lambda d, f: with_odometry(d, degrees), "degrees"),
    "swapped": (lambda d, f: with_odometry(d, lambda p: p[:, [1, 0, 2]]), "other way round"),
    "never turns": (lambda d, f: with_odometry(d, lambda p: p * [1, 1, 0]), "never changes"),
    "centimetres": (lambda d, f: with_odometry(d, lambda p: p * [100, 100, 1]), "centimetres"),
    "millimetres": (lambda d, f: with_odometry(d, lambda p: p * [1000, 1000, 1]), "millimetres"),
    "heading 180": (lambda d, f: with_camera(d, heading_column=d.image_size[0] / 2), "heading fits"),
    "heading 90": (lambda d, f: with_camera(d, heading_column=d.image_size[0] / 4), "heading fits"),
    "0.3 s late": (lambda d, f: with_odometry(d, same, 0.3), "clock fits"),
    "0.5 s late": (lambda d, f: with_odometry(d, same, 0.5), "clock fits"),
    "1.5 s late": (lambda d, f: with_odometry(d, same, 1.5), "clock fits"),
    "3 s late": (lambda d, f: with_odometry(d, same, 3.0), "clock fits"),
    "12 s late": (lambda d, f: with_odometry(d, same, 12.0), "clock fits"),
    "2 s early": (lambda d, f: with_odometry(d, same, -2.0), "clock fits"),
    "frames in ms": (lambda d, f: replace(d, times=d.times * 1e3), "milliseconds"),
    "odometry in ns": (lambda d, f: replace(d, odometry=Trajectory(d.odometry.times * 1e9, d.odometry.poses)), "nanoseconds"),
    "both in ns": (
        lambda d, f: replace(
            d, times=(1.7e9 + d.times) * 1e9, odometry=Trajectory((1.7e9 + d.odometry.times) * 1e9, d.odometry.poses)
        ),
        "nanoseconds",
    ),
    "both in us": (
        lambda d, f: replace(
            d, times=(1.7e9 + d.times) * 1e6, odometry=Trajectory((1.7e9 + d.odometry.times) * 1e6, d.odometry.poses)
        ),
        "microseconds",
    ),
    "odometry in us": (lambda d, f: replace(d, odometry=Trajectory(d.odometry.times * 1e6, d.odometry.poses)), "microseconds"),
    "both in ms": (
        lambda d, f: replace(
            d, times=(d.times - d.times[0]) * 1e3, odometry=Trajectory((d.odometry.times - d.times[0]) * 1e3, d.odometry.poses)
        ),
        "milliseconds",
    ),
}
