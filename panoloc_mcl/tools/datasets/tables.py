"""The CSV files of a data set: named columns, numbers checked, every fault with file and line."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from panoloc_mcl.robot.errors import DatasetError, did_you_mean
from panoloc_mcl.robot.files import text_of, write_atomically

_MOST_FAULTS = 20


@dataclass(frozen=True, eq=False)
class ImageTable:
    """Images and the numbers that belong to them.

    Parameters
    ----------
    files : tuple of Path
        Paths of the images (folder of the table joined with the name in it).
    numbers : ndarray of float64, shape (n, number of columns)
        In the order asked for; NaN where an optional one is not given.
    """

    files: tuple[Path, ...]
    numbers: NDArray[np.float64]


def read_image_table(
    path: Path,
    columns: tuple[str, ...],
    rising: str | None,
    faults: list[str],
    root: Path | None = None,
    optional: tuple[str, ...] = (),
    unknown: tuple[str, ...] = (),
) -> ImageTable | None:
    """Read a CSV file with a column ``file`` and columns of numbers, in any order.

    Parameters
    ----------
    path : Path
    columns : tuple of str
        The columns of numbers.
    rising : str or None
        A column that must strictly increase.
    optional : tuple of str
        Further columns of positive numbers, which may be missing or empty; they come last.
    unknown : tuple of str
        Columns of any numbers, which may be missing or empty; they come after ``columns``.
    faults : list of str
        Gets a line for every fault: missing file or column, unknown column, values that are no finite numbers, images that
        do not exist, are named twice or lie elsewhere, values that do not increase.
    root : Path, optional
        Folder that the images must lie in; that of the table if left out.

    Returns
    -------
    ImageTable or None
        None when there were faults.
    """
    try:
        text = text_of(path, DatasetError)
    except DatasetError as error:
        faults.extend(error.faults)
        return None
    except FileNotFoundError:
        faults.append(f"{path}: no such file; add it with the columns {', '.join(('file', *columns, *unknown))}")
        return None
    except OSError as error:
        faults.append(f"{path}: cannot be read ({error}); check permissions")
        return None
    # Strict, as an open quote would swallow the rest of the file without a word.
    reader = csv.reader(io.StringIO(text), skipinitialspace=True, strict=True)
    try:
        lines = [(reader.line_num, fields) for fields in reader]
    except csv.Error as error:
        faults.append(f"{path}:{reader.line_num}: not valid CSV ({error}); close the quotes")
        return None
    header = [name.strip() for name in (lines.pop(0)[1] if lines else [])]
    found = _header_faults(path, header, ("file", *columns), (*unknown, *optional))
    if found:
        faults.extend(found)
        return None
    place = {name: header.index(name) for name in header}
    files: list[Path] = []
    numbers: list[list[float]] = []
    first_line: dict[str, int] = {}
    last = -math.inf
    for line, fields in lines:
        where = f"{path}:{line}"
        if not any(value.strip() for value in fields):
            continue
        if len(fields) != len(header):
            found.append(f"{where}: {len(fields)} values; must be {len(header)}: {','.join(header)}")
            continue
        row = [_number(fields[place[name]], name, where, found) for name in columns]
        for name in unknown:
            text = fields[place[name]] if name in place else ""
            row.append(_number(text, name, where, found) if text.strip() else math.nan)
        row += [_positive(fields[place[name]] if name in place else "", name, where, found) for name in optional]
        name = fields[place["file"]].strip()
        _check_file(path.parent, root or path.parent, name, where, first_line, line, found)
        files.append(path.parent / name)
        numbers.append(row)
        if rising is not None and math.isfinite(value := row[columns.index(rising)]):
            if value <= last:
                found.append(f"{where}: {rising} = {value:.9f} does not increase (before it {last:.9f}); sort, drop doubles")
            last = max(last, value)
    if not files and not found:
        found.append(f"{path}: holds no rows; name at least one image")
    if found:
        more = len(found) - _MOST_FAULTS
        faults.extend(found[:_MOST_FAULTS] + ([f"{path}: and {more} more faults like these"] if more > 0 else []))
        return None
    return ImageTable(tuple(files), np.asarray(numbers, dtype=np.float64))


def write_image_table(path: Path, header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    """Write a CSV file atomically.

    Raises
    ------
    DatasetError
        The file cannot be written.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_atomically(path, out.getvalue())


def _header_faults(path: Path, header: list[str], needed: tuple[str, ...], optional: tuple[str, ...]) -> list[str]:
    where, known = f"{path}:1", ",".join((*needed, *optional))
    must = ",".join(needed) + (f" ({','.join(optional)} are optional)" if optional else "")
    for mark, called in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars"), (" ", "spaces")):
        if len(header) == 1 and len(set(header[0].split(mark)) & {*needed, *optional}) > 1:
            return [f"{where}: columns are separated by {called}; separate them by commas, and write decimals with a point"]
    if not {*needed, *optional} & set(header):
        return [f"{where}: names no columns that are known; the first line must name {must}"]
    faults = [f"{where}: column '{name}' is missing; the first line must name {must}" for name in needed if name not in header]
    for name in (name for name in header if name not in (*needed, *optional)):
        hint = did_you_mean(name.lower(), sorted({*needed, *optional} - set(header)))
        faults.append(f"{where}: unknown column '{name}'; known: {known}{'; ' + hint if hint else ''}")
    faults += [f"{where}: column '{name}' is given twice; keep one" for name in sorted(set(header)) if header.count(name) > 1]
    return faults


def _number(text: str, name: str, where: str, faults: list[str]) -> float:
    try:
        value = float(text)
    except ValueError:
        faults.append(f"{where}: {name} = '{text.strip()}' is not a number; mend or drop this row")
        return math.nan
    if not math.isfinite(value):
        faults.append(f"{where}: {name} = {text.strip()} is not finite; mend or drop this row")
    return value


def _positive(text: str, name: str, where: str, faults: list[str]) -> float:
    """NaN for an empty cell."""
    if not text.strip():
        return math.nan
    before = len(faults)
    value = _number(text, name, where, faults)
    if len(faults) == before and value <= 0.0:
        faults.append(f"{where}: {name} = {text.strip()} must be above 0; leave it empty if it is not known")
    return value


def _check_file(
    folder: Path, root: Path, name: str, where: str, first_line: dict[str, int], line: int, faults: list[str]
) -> None:
    key = str(PurePosixPath(name))
    if not name:
        faults.append(f"{where}: file is empty; name the image")
    elif key in first_line:
        faults.append(f"{where}: file {name} is already in line {first_line[key]}; keep one of the two rows")
    elif not is_inside(folder / name, root):
        faults.append(f"{where}: file {name}: leads out of {root}; copy the image into the data set")
    elif not _is_file(folder / name):
        remedy = f"write {there}" if (there := _elsewhere(folder, name)) else "add the image, or drop this row"
        faults.append(f"{where}: file {name}: no such file in {folder}; {remedy}")
    first_line.setdefault(key, line)


def _elsewhere(folder: Path, name: str) -> str | None:
    """The image of that name one folder below, where there is just one, as a table would write it."""
    image = PurePosixPath(name).name
    with os.scandir(folder) as entries:
        below = [entry.name for entry in entries if image and entry.is_dir() and _is_file(folder / entry.name / image)]
    return f"{below[0]}/{image}" if len(below) == 1 else None


def is_inside(path: Path, root: Path) -> bool:
    """Whether a path, as it is written, stays below a folder; links that the user made may lead anywhere."""
    return Path(os.path.abspath(path)).is_relative_to(os.path.abspath(root))  # noqa: PTH100 resolve() would follow links


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        # A name that is too long for any file, or a folder that may not be looked into.
        return False
