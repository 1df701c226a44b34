"""What a result was computed by: digests of this package's own source, as parts of cache keys."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

_ROOT = Path(__file__).parents[1]

#: What a map depends on beside its references and settings.
OF_MAPS = (
    "robot/camera/",
    "robot/eigenspace/",
    "robot/geometry.py",
    "robot/images.py",
    "robot/kernels/",
    "robot/map/",
    "robot/observation/",
    "robot/references.py",
    "robot/synthesis/",
)


@lru_cache(maxsize=16)
def source_digest(parts: tuple[str, ...] = ("",), without: tuple[str, ...] = ()) -> str:
    """Digest of source files: changes with their code, but not with lines that are comments only.

    Parameters
    ----------
    parts : tuple of str
        Beginnings of paths within the package, such as ``robot/kernels/``; all of it by default.
    without : tuple of str
        Beginnings of paths that do not count.
    """
    digest = hashlib.sha256()
    for file in sorted(_ROOT.rglob("*.py")):
        name = file.relative_to(_ROOT).as_posix()
        # The package's own page holds its version, which counts for all.
        if name == "__init__.py" or (name.startswith(parts) and not name.startswith(without)):
            digest.update("\n".join([name, *_code(file.read_text(encoding="utf-8").splitlines())]).encode())
    return digest.hexdigest()[:16]


def _code(lines: Sequence[str]) -> list[str]:
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
