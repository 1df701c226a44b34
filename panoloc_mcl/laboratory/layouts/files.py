"""Drives as the COLD layout, as a video with tables beside it, and as a folder of images named by their times."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

from panoloc_mcl.laboratory.layouts.bags import nanoseconds
from panoloc_mcl.robot.errors import DatasetError
from panoloc_mcl.robot.files import write_atomically
from panoloc_mcl.robot.images import ImageSource, read_image, write_image
from panoloc_mcl.tools.datasets import Sequence, Trajectory, write_tum


def write_cold(drive: Sequence, path: Path, ending: str = ".jpeg") -> Path:
    """As the COLD database: the folder ``PATH``; stamps to a microsecond, true poses in the images' names.

    Raises
    ------
    DatasetError
        The drive has no ground truth, which the names of images need.
    """
    if drive.groundtruth is None:
        raise DatasetError(f"{drive.path}: has no groundtruth.tum, and in this layout it stands in the images' names; add it")
    for time, file in zip(drive.times.tolist(), drive.files, strict=True):
        micros, (x, y, a) = round(Fraction(time) * 10**6), drive.groundtruth.at(time).tolist()
        name = f"t{micros // 10**6}.{micros % 10**6:06d}_x{x!r}_y{y!r}_a{a!r}{ending}"
        _put(file, path / "omni_cam" / name)
    (path / "localization").mkdir(parents=True, exist_ok=True)
    write_atomically(path / "localization" / "places.lst", "")
    if drive.odometry is not None:
        lines = ["# PLAYER LOG FILE"]
        for time, (x, y, a) in _rows(drive.odometry):
            micros = round(Fraction(time) * 10**6)
            lines.append(f"robot 6665 {micros // 10**6} {micros % 10**6} position 00 001 {x!r} {y!r} 0 {a!r} 0 0 0")
        write_atomically(path / "odom_scans" / "odom.tdf", "\n".join(lines) + "\n")
    return path


def write_video(drive: Sequence, path: Path, ending: str = ".mkv", codec: str = "ffv1", odometry: str = "tum") -> Path:
    """As a video, ``PATH.mkv`` or another ending, with the times of its frames and trajectories beside it (extra ``bags``).

    Parameters
    ----------
    drive : Sequence
    path : Path
    ending, codec : str
        ``ffv1`` keeps every bit of 8-bit images.
    odometry : str
        ``tum`` or ``csv``.
    """
    import av

    target = path.with_name(path.name + ending)
    first = read_image(drive.files[0])
    target.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(target), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.height, stream.width = first.shape[0], first.shape[1]
        grey = first.ndim == 2
        # Without halved chroma, so that sizes may be odd.
        stream.pix_fmt = "gray" if grey else "bgr0" if codec == "ffv1" else "yuv444p"
        if codec == "libx264":
            stream.options = {"crf": "12"}
        for file in drive.files:
            frame = av.VideoFrame.from_ndarray(read_image(file), format="gray" if grey else "bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    stamps = (nanoseconds(time) for time in drive.times.tolist())
    lines = ["timestamp", *(f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in stamps)]
    write_atomically(path.with_name(f"{path.name}.frames.csv"), "\n".join(lines) + "\n")
    if drive.odometry is not None and odometry == "csv":
        rows = ["timestamp,x,y,theta", *(f"{t!r},{x!r},{y!r},{a!r}" for t, (x, y, a) in _rows(drive.odometry))]
        write_atomically(path.with_name(f"{path.name}.odometry.csv"), "\n".join(rows) + "\n")
    elif drive.odometry is not None:
        _put_track(drive, "odometry", path.with_name(f"{path.name}.odometry.tum"))
    _put_track(drive, "groundtruth", path.with_name(f"{path.name}.groundtruth.tum"))
    return target


def write_folder(drive: Sequence, path: Path) -> Path:
    """As a folder of images named by their times, ``PATH``."""
    for time, file in zip(drive.times.tolist(), drive.files, strict=True):
        stamp = nanoseconds(time)
        _put(file, path / "images" / f"{stamp // 10**9}.{stamp % 10**9:09d}.png")
    for part in ("odometry", "groundtruth"):
        _put_track(drive, part, path / f"{part}.tum")
    return path


def _put(file: ImageSource, target: Path) -> None:
    """An image under another name, as it is if its ending stays."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(file, Path) and file.suffix == target.suffix:
        shutil.copyfile(file, target)
    else:
        write_image(target, read_image(file))


def _put_track(drive: Sequence, part: str, target: Path) -> None:
    trajectory: Trajectory | None = getattr(drive, part)
    if (drive.path / f"{part}.tum").is_file():
        shutil.copyfile(drive.path / f"{part}.tum", target)
    elif trajectory is not None:
        write_tum(target, trajectory)


def _rows(trajectory: Trajectory) -> Iterator[tuple[float, list[float]]]:
    return zip(trajectory.times.tolist(), trajectory.poses.tolist(), strict=True)
