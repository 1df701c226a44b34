"""What a long build has worked out, kept beside its output: a build that was killed goes on there."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from panoloc_mcl.robot.errors import OutputError
from panoloc_mcl.robot.files import UNFINISHED, read_arrays, write_arrays
from panoloc_mcl.robot.source import source_digest

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Maps are made by the robot's wing.
_BUILDERS = ("robot/",)


class Parts:
    """What a long build has worked out, in a folder beside its output: a build that was killed goes on there.

    Steps are told apart by their names and, of one name, by their order: a build must take the same steps each time.

    Parameters
    ----------
    folder : Path, optional
        None: nothing is kept.
    key : str
        Names what the parts were made of, 64 letters as of SHA-256; those of anything else, or by another version of this program, are
        made anew.
    """

    def __init__(self, folder: Path | None = None, key: str = "") -> None:
        self._folder, self._key = folder, key
        self._steps: Counter[str] = Counter()

    def each(
        self, name: str, count: int, size: int, make: Callable[[slice], Mapping[str, NDArray[Any]]]
    ) -> Iterator[tuple[slice, Mapping[str, NDArray[Any]]]]:
        """So many results in blocks of a size: where each block lies, and its arrays, which ``make`` makes where none are kept.

        Raises
        ------
        OutputError
            A part cannot be written.
        """
        self._steps[name] += 1
        step = f"{self._key[:16]}-{name.replace(' ', '_')}-{self._steps[name]}"
        for first in range(0, count, size):
            block = slice(first, min(first + size, count))
            yield block, self._of(f"{step}-{block.start}-{block.stop}.npz", block, make)

    def listed(
        self,
        name: str,
        count: int,
        size: int,
        work: Callable[[int], Iterable[Sequence[Any]]],
        threads: int = 1,
        progress: Callable[[int, int, str], None] = lambda done, total, what: None,
    ) -> list[NDArray[Any]]:
        """Columns of a table: the rows that ``work`` lists for each index, in their order; some indices are at work at once.

        Parameters
        ----------
        name : str
            As progress is told.
        count : int
            Of indices.
        size : int
            So many of them are kept together.
        work : callable (index) -> rows
            Numbers or arrays, of one type and shape in each column.
        threads : int
            The result does not depend on it.
        progress : callable (done, total, what)
            Is told of every index that was worked on.

        Returns
        -------
        list of array (rows, ...)
            None at all if there are no rows.

        Raises
        ------
        OutputError
            A part cannot be written.
        """
        import numpy as np

        with ThreadPoolExecutor(max_workers=threads) as pool:

            def block_of(block: slice) -> dict[str, NDArray[Any]]:
                rows: list[Sequence[Any]] = []
                for index, some in enumerate(pool.map(lambda one: list(work(one)), range(block.start, block.stop))):
                    rows += some
                    progress(block.start + index + 1, count, name)
                return {str(number): np.array(column) for number, column in enumerate(zip(*rows, strict=True))}

            blocks = [list(found.values()) for _, found in self.each(name, count, size, block_of) if found]
        return [np.concatenate(column) for column in zip(*blocks, strict=True)]

    def _of(self, name: str, block: slice, make: Callable[[slice], Mapping[str, NDArray[Any]]]) -> Mapping[str, NDArray[Any]]:
        if self._folder is None:
            return make(block)
        path, made_of = self._folder / name, {"key": self._key, "code": source_digest(_BUILDERS)}
        with suppress(ValueError, OSError):
            header, arrays = read_arrays(path)
            if header == made_of:
                return arrays
        made = make(block)
        try:
            write_arrays(path, made_of, made)
        except OutputError:
            # Another process that built the same map may have removed the folder just now.
            write_arrays(path, made_of, made)
        return made


def remove_parts(folder: Path) -> None:
    """Remove what `Parts` kept in a folder, and the folder itself if nothing else lies there; what cannot be removed stays."""
    with suppress(OSError):
        for path in list(folder.iterdir()):
            # Also what `write_atomically` left of a part when its process was killed.
            if re.fullmatch(rf"\.?[0-9a-f]{{16}}-.+\.npz(\..+{re.escape(UNFINISHED)})?", path.name):
                path.unlink(missing_ok=True)
        folder.rmdir()
