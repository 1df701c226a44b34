"""Errors a user can mend. The command line prints them as single lines and exits with code 2."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

# What is spelt much like something else that is known.
_ALSO_CALLED = {"anticlockwise": "counterclockwise", "anti-clockwise": "counterclockwise"}


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """``did you mean '…'?`` with the word that is most alike; empty where none is alike."""
    import difflib

    names = list(known)
    meant = _ALSO_CALLED.get(str(word).lower(), "")
    close = [meant] if meant in names else difflib.get_close_matches(str(word), names, n=1, cutoff=0.5)
    return f"did you mean '{close[0]}'?" if close else ""


class PanolocError(Exception):
    """Root of every known error; carries one or more faults, each a single line.

    Parameters
    ----------
    faults : str or iterable of str
        One line a fault: where (file, row or key), what was found, and the remedy.
    """

    def __init__(self, faults: str | Iterable[str]) -> None:
        lines = [faults] if isinstance(faults, str) else list(faults)
        self.faults: Sequence[str] = tuple(" ".join(line.split()) for line in lines)
        super().__init__("\n".join(self.faults))


class ConfigError(PanolocError):
    """A configuration or a YAML file that cannot be used."""


class DatasetError(PanolocError):
    """A data set that breaks the layout, or whose files cannot be read."""


class CameraError(PanolocError):
    """A camera description that is impossible, or that does not fit the images."""


class ImageError(PanolocError):
    """An image that cannot be used: unreadable, of another size or type than the camera delivers."""


class FrozenCameraError(ImageError):
    """An image that came before, although the robot has moved since."""


class MapError(PanolocError):
    """A map that cannot be built, read, or used with this camera or configuration."""


class MeasurementError(PanolocError, ValueError):
    """A time stamp or a pose handed to the localizer that is none: text, nothing, or another number of values."""


class StateError(PanolocError):
    """A saved state of a localizer that is damaged, or was saved with another map or other settings."""


class OutputError(PanolocError):
    """A file that cannot be written."""


class ResultsError(PanolocError):
    """A results folder that is incomplete, foreign, or cannot be written."""
