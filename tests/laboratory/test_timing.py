import cv2
import pytest

from panoloc_mcl.laboratory.timing import one_thread


def interrupted() -> None:
    with one_thread():
        assert cv2.getNumThreads() == 1
        raise InterruptedError


def test_threads_are_as_they_were_afterwards_whatever_happened():
    before = cv2.getNumThreads()
    with pytest.raises(InterruptedError):
        interrupted()
    assert cv2.getNumThreads() == before
