"""Reference panoramas: turned by what their headings were off."""

import numpy as np

from panoloc_mcl.robot.references import read_references, turned
from panoloc_mcl.tools.datasets import Dataset


def test_panoramas_are_turned_as_though_they_had_been_read_with_the_right_headings(small_room: Dataset) -> None:
    references = small_room.references
    off = np.linspace(-0.2, 0.2, len(references))
    off[3] = 0.0
    assumed = references.standpoints
    assumed[:, 2] -= off
    right, wrong = read_references(references), read_references(references.moved_to(assumed))
    again = turned(wrong, off)

    def apart(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.abs(a.astype(float) - b).mean())

    assert apart(again.pixels, right.pixels) < 0.2 * apart(wrong.pixels, right.pixels)
    assert apart(turned(wrong, -off).pixels, right.pixels) > apart(wrong.pixels, right.pixels)
    np.testing.assert_array_equal(again.pixels[3], wrong.pixels[3])
    # To and fro as often as one likes: nothing is blurred.
    there_and_back = wrong
    for _ in range(5):
        there_and_back = turned(turned(there_and_back, off), -off)
    assert apart(there_and_back.pixels, wrong.pixels) < 2.0
