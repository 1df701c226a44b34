"""Data sets that come with the package, and where a data set given by name or path lies."""

from __future__ import annotations

from pathlib import Path

from panoloc_mcl.robot.errors import DatasetError, did_you_mean
from panoloc_mcl.robot.files import at_home, known_errors
from panoloc_mcl.tools.datasets.recordings import FILES, is_recording

#: Folders of the data sets in the package, by name.
EMBEDDED: dict[str, Path] = {
    "hall": Path(__file__).parent / "embedded_hall",  # made by: panoloc simulate configs/simulate_embedded.yaml
}


def resolve_dataset(name_or_path: str | Path) -> Path:
    """The folder of a data set given by path, or by the name of an embedded one.

    A folder of that name goes first only if it is a data set.

    Parameters
    ----------
    name_or_path : str or Path

    Raises
    ------
    DatasetError
        Neither a folder, a recording nor a known name; with the nearest name.
    """
    path = at_home(name_or_path, "dataset")
    with known_errors(DatasetError, path):
        if (path / "dataset.yaml").is_file():
            return path
        embedded = EMBEDDED.get(str(name_or_path))
        if embedded is not None:
            return embedded
        if path.is_dir() or is_recording(path):
            return path
        if path.is_file():
            raise DatasetError(
                f"dataset = '{name_or_path}': a file that is no recording ({', '.join(FILES)}); give one of these, or a folder"
            )
    hint = did_you_mean(name_or_path, EMBEDDED) or "check the path"
    raise DatasetError(f"dataset = '{name_or_path}': neither a folder nor an embedded data set ({', '.join(EMBEDDED)}); {hint}")
