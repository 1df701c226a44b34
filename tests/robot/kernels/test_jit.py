import os
import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import numba
import numpy as np
import pytest

from panoloc_mcl.robot.kernels import jit

HERE = Path(__file__).parent


def test_without_a_folder_for_the_cache_kernels_still_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locator(*, cache: bool = False, **options):
        if cache:

            def refuse(function):
                raise RuntimeError(f"cannot cache function {function.__name__!r}: no locator available")

            return refuse
        return numba.njit(**options)

    monkeypatch.setattr(jit, "numba", SimpleNamespace(njit=no_locator))
    monkeypatch.setattr(jit, "_warned", False)

    def double(x):
        return x + x

    with pytest.warns(RuntimeWarning, match="NUMBA_CACHE_DIR") as caught:
        doubled = jit.kernel(double)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jit.kernel(double)
    assert doubled(1.5) == 3.0


def test_division_by_zero_is_as_in_numpy() -> None:
    @jit.kernel
    def divide(a, b):
        return a / b

    with np.errstate(divide="ignore", invalid="ignore"):
        assert np.isinf(divide(np.float64(1.0), np.float64(0.0)))
        assert np.isnan(divide(np.float64(0.0), np.float64(0.0)))


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="is what this test starts")
@pytest.mark.slow
def test_kernels_agree_with_their_oracles_without_the_compiler() -> None:
    """The whole package must stand NUMBA_DISABLE_JIT=1: for debugging, and for coverage."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(HERE), "-k", "agree and not interpreted"]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    run = subprocess.run(
        command, cwd=HERE.parents[2], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stdout[-3000:]
    assert " passed" in run.stdout
