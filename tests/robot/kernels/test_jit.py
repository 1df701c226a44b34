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


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_a_kernel_that_was_kept_for_other_types_is_compiled_again(tmp_path: Path) -> None:
    """As two processes leave it that compile at once, for different types, into one folder."""
    (tmp_path / "one_kernel.py").write_text(
        "from panoloc_mcl.robot.kernels.jit import kernel\n\n@kernel\ndef first(a):\n    return a[0]\n", encoding="utf-8"
    )
    paths = os.pathsep.join([str(HERE.parents[2]), str(tmp_path)])
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": paths}

    def called_with(dtype: str) -> subprocess.CompletedProcess[str]:
        code = f"import numpy, one_kernel; print(one_kernel.first(numpy.full(4, 2.5, numpy.{dtype})))"
        return subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120, check=False
        )

    assert called_with("float64").stdout == "2.5\n"
    (data,) = (tmp_path / "kept").rglob("*.nbc")
    other = data.read_bytes()
    for file in (tmp_path / "kept").rglob("*.nb?"):
        file.unlink()
    assert called_with("float32").stdout == "2.5\n"
    data.write_bytes(other)
    mixed = called_with("float32")
    assert mixed.stdout == "2.5\n"
    assert "compiled again" in mixed.stderr
    assert called_with("float32").stderr == ""
