"""What filters remember besides their belief: typed values, with a form on disk that says its version."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


class Kept:
    """Base of dataclasses of plain values that go into the header of a saved state."""

    def header(self, form: str) -> dict[str, Any]:
        """Plain values, with the form that they are in."""
        fields = dataclasses.fields(self)  # type: ignore[arg-type]
        return {"form": form, **{field.name: getattr(self, field.name) for field in fields}}

    @classmethod
    def of_header(cls, header: Mapping[str, Any], form: str) -> Self:
        """What `header` gave.

        Raises
        ------
        KeyError, ValueError
            A value is missing or of another type, or the form is another one.
        """
        if header.get("form") != form:
            raise ValueError(f"the filter's state has the form {header.get('form')!r}, this version reads '{form}'")
        values = {}
        for field in dataclasses.fields(cls):  # type: ignore[arg-type]
            value = header[field.name]
            wanted = _TYPES[str(field.type)]
            if isinstance(value, bool) != (wanted is bool) or not isinstance(value, wanted):
                raise ValueError(f"{field.name} = {value!r}: not {field.type}")
            values[field.name] = tuple(value) if isinstance(value, list) else value
        return cls(**values)


_TYPES: dict[str, Any] = {
    "bool": bool,
    "int": int,
    "float": (int, float),
    "tuple[float, ...] | None": (list, tuple, type(None)),
}


@dataclass
class Memory(Kept):
    """Of the particle filter, besides the particles.

    Parameters
    ----------
    key, step : int
        Of the random numbers.
    nothing_known : bool
        No image has been taken in, and no start pose was given.
    known : bool
        Whether any answer before the last one was sure; who never knew the pose cannot be lost.
    sure : bool
        Whether the last answer was.
    vouched : bool
        Whether a start pose, or an image that was sure enough of itself (two, of more noise than world), stands behind the belief.
    expected : (x, y, heading, spread_m, spread_deg) or None
        If the answer before was sure: where odometry led from its pose, up to now. Metres, radians, degrees.
    match, match_slow, match_fast : float
        How much of the best cell's likelihood the prediction explained: of the last image, and running averages.
    fit : float
        What the belief explains of the best votes once it has seen the image, running average.
    elsewhere : float
        Probability, the last image seen, that the robot is not where odometry led.
    place_votes : float
        Votes at the reported pose.
    effective : float
        N_eff before the last resampling.
    resampled : bool
    injected : int
    way : float
        Driven since an image was last taken in, metres.
    seen : tuple (x, y, heading) or None
        Best pose of the votes of that image.
    """

    key: int
    step: int
    nothing_known: bool
    effective: float
    known: bool = False
    sure: bool = False
    vouched: bool = False
    expected: tuple[float, ...] | None = None
    match: float = math.nan
    match_slow: float = math.nan
    match_fast: float = math.nan
    fit: float = math.nan
    elsewhere: float = math.nan
    place_votes: float = math.nan
    resampled: bool = False
    injected: int = 0
    way: float = 0.0
    seen: tuple[float, ...] | None = None

    def forget_last_image(self) -> None:
        """What was true of the last answer is what was known before this one."""
        self.known = self.known or self.sure
        self.expected, self.match, self.place_votes = None, math.nan, math.nan
        self.resampled, self.injected = False, 0

    def lead_on(self, increment: NDArray[np.float64]) -> None:
        """The expected pose after a motion (3,), as seen from its start: metres and radians."""
        if self.expected is not None:
            x, y, heading, *spreads = self.expected
            ahead, left, turn = increment.tolist()
            cos, sin = math.cos(heading), math.sin(heading)
            self.expected = (x + cos * ahead - sin * left, y + sin * ahead + cos * left, heading + turn, *spreads)

    def matched(self, match: float, slow: float, fast: float) -> None:
        """Take down how much of an image the prediction explained; the running averages follow by these shares."""
        self.match = match
        self.match_slow, self.match_fast = _running(self.match_slow, match, slow), _running(self.match_fast, match, fast)

    def explained(self, fit: float, share: float) -> None:
        """Take down what the belief explains of an image once it has seen it; the running average follows by a share."""
        self.fit = _running(self.fit, fit, share)

    @property
    def fallen(self) -> float:
        """By what share images fit worse of late than they used to."""
        return 1.0 - self.match_fast / self.match_slow if self.match_slow > 0.0 else 1.0


def _running(average: float, value: float, share: float) -> float:
    return value if math.isnan(average) else average + share * (value - average)
