"""Whatever the machine is like: closed folders, shut streams, variables that hold nonsense, damaged files."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from panoloc_mcl.robot.files import CACHE_VARIABLE

ROOT = Path(__file__).parents[3]
SHOW_JIT = "import warnings; warnings.simplefilter('always'); import panoloc_mcl.robot.kernels.jit; import numba"
COMPILE = (
    "from panoloc_mcl.robot.kernels.examples import EXAMPLES, find;"
    "find('filtering.weights.likelihoods')(*EXAMPLES['filtering.weights.likelihoods']()); print('done')"
)


@pytest.fixture
def forbid(monkeypatch):
    """Make paths as though this user may not look at them; root may look at everything."""

    def call(*closed: Path) -> None:
        def guarded(function):
            def looked_at(path, *args, **kwargs):
                if isinstance(path, str | Path) and any(Path(path) == p or p in Path(path).parents for p in closed):
                    raise PermissionError(13, "Permission denied", str(path))
                return function(path, *args, **kwargs)

            return looked_at

        for module, name in ((os, "stat"), (os, "listdir"), (os, "scandir"), (io, "open")):
            monkeypatch.setattr(module, name, guarded(getattr(module, name)))

    return call


@pytest.mark.parametrize(
    "closed",
    ["dataset.yaml", "references", "references/poses.csv", "references/camera.yaml", "sequences", "sequences/noon_00", "."],
)
@pytest.mark.parametrize("command", ["run", "check"])
def test_what_is_not_permitted_is_one_line(command, closed, panoloc, small_room, forbid):
    forbid(small_room / closed)
    done = panoloc(command, ROOT / "configs" / "global.yaml", "--set", f"dataset={small_room}")
    assert done.code == 2
    assert "Permission denied" in done.err
    assert str(small_room) in done.err
    assert "Traceback" not in done.err


def test_a_map_in_a_closed_folder(panoloc, small_room, tmp_path, forbid):
    forbid(tmp_path / "closed")
    config = ROOT / "configs" / "global.yaml"
    done = panoloc("run", config, "--set", f"dataset={small_room}", "--set", f"map={tmp_path / 'closed' / 'a.panomap'}")
    assert done.code == 2
    assert "a.panomap: cannot be read (Permission denied)" in done.err


@pytest.mark.slow
def test_the_cache_of_another_user_costs_a_warning_and_not_the_run(panoloc, run_small, tmp_path, forbid, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "theirs"))
    forbid(tmp_path / "theirs")
    monkeypatch.setattr(os, "mkdir", _not_under(os.mkdir, tmp_path / "theirs"))
    done = run_small("--set", "observation.votes.virtual_places.enabled=false")
    assert done.code == 0
    assert "map not kept for the next run" in done.err


def _not_under(function, closed):
    def guarded(path, *args, **kwargs):
        if closed in (Path(path), *Path(path).parents):
            raise PermissionError(13, "Permission denied", str(path))
        return function(path, *args, **kwargs)

    return guarded


@pytest.mark.parametrize("value", ["~nobody-of-that-name/x"])
def test_a_cache_at_the_home_of_nobody(value, run_small, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, value)
    done = run_small()
    assert done.code == 2
    assert done.err.splitlines()[-1].startswith(f"PANOLOC_CACHE_DIR = {value}: there is no such home folder")


def buffered() -> dict[str, str]:
    """The environment of a user whose output is buffered, as it is unless PYTHONUNBUFFERED says otherwise."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}


@pytest.mark.slow
@pytest.mark.parametrize("shut", [">&-", "2>&-", ">&- 2>&-", "> /dev/full"])
def test_streams_that_are_shut(shut, small_room):
    words = f"{sys.executable} -m panoloc_mcl inspect {small_room} {shut}"
    done = subprocess.run(["sh", "-c", words], capture_output=True, text=True, cwd=ROOT, env=buffered())
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert done.returncode == (2 if "full" in shut else 0)


@pytest.mark.parametrize(("ending", "code"), [("", 120), ("; main._leave_unwritten()", 0)])
def test_what_a_full_disk_leaves_of_the_output_is_let_go(ending: str, code: int) -> None:
    """The interpreter flushes it once more when it ends, and complains."""
    words = (
        f"{sys.executable} -c 'import sys; from panoloc_mcl.tools.cli import main; sys.stdout.write(\"x\"){ending}' > /dev/full"
    )
    done = subprocess.run(["sh", "-c", words], capture_output=True, text=True, cwd=ROOT, env=buffered())
    assert done.returncode == code, done.stderr
    assert ("Exception ignored" in done.stderr) is (code == 120)


@pytest.mark.slow
def test_a_terminal_that_knows_ascii_only(panoloc_process, small_room, tmp_path):
    done = panoloc_process("inspect", small_room, cwd=tmp_path, PYTHONIOENCODING="ascii", LC_ALL="C")
    assert done.code == 0
    assert "references" in done.out


@pytest.mark.parametrize("threads", ["", "abc", "0", "-1", "1.5"])
def test_numbers_of_threads_that_are_none(threads):
    environment = {**os.environ, "NUMBA_NUM_THREADS": threads}
    done = subprocess.run([sys.executable, "-c", SHOW_JIT], capture_output=True, text=True, cwd=ROOT, env=environment)
    assert done.returncode == 0, done.stderr
    assert f"NUMBA_NUM_THREADS = '{threads}' is no number of threads" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("kept", [0, 40])
def test_damaged_compiled_kernels_are_compiled_again(ending, kept, tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def call():
        return subprocess.run([sys.executable, "-c", COMPILE], capture_output=True, text=True, cwd=ROOT, env=environment)

    assert call().stdout == "done\n"
    files = list(tmp_path.rglob(f"*.{ending}"))
    assert files
    for file in files:
        file.write_bytes(file.read_bytes()[:kept])
    done = call()
    assert done.stdout == "done\n", done.stderr
    assert "compiled kernels" in done.stderr


@pytest.mark.slow
def test_kernels_that_cannot_be_kept_cost_a_line(tmp_path):
    """A disk that fills up while they are written."""
    full = "from numba.core.caching import FunctionCache\ndef full(*_): raise OSError(28, 'No space left on device')\n"
    script = full + "FunctionCache.save_overload = full\n" + COMPILE
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, env=environment)
    assert done.stdout == "done\n", done.stderr
    assert "compiled kernels are not kept" in done.stderr
    assert "No space left" in done.stderr
    assert "Traceback" not in done.stderr


class TestTables:
    def test_an_open_quote_is_named(self, panoloc, small_room):
        table = small_room / "references" / "poses.csv"
        lines = table.read_text().splitlines()
        lines[3] = '"' + lines[3]
        table.write_text("\n".join(lines))
        done = panoloc("build-map", small_room, "-o", "a.panomap")
        assert done.code == 2
        assert "not valid CSV" in done.err
        assert "close the quotes" in done.err

    @pytest.mark.parametrize("name", ["../../../secret.png", "/etc/passwd", "../../room2/a.png"])
    def test_no_image_lies_outside(self, name, panoloc, small_room):
        table = small_room / "references" / "poses.csv"
        lines = table.read_text().splitlines()
        file = lines[1].split(",")[lines[0].split(",").index("file")]
        table.write_text(table.read_text().replace(file, name, 1))
        done = panoloc("build-map", small_room, "-o", "a.panomap")
        assert done.code == 2
        assert f"file {name}: leads out of {small_room}" in done.err

    @pytest.mark.slow
    def test_images_may_lie_elsewhere_in_the_data_set(self, panoloc, small_room):
        table = small_room / "sequences" / "noon_00" / "frames.csv"
        lines = table.read_text().splitlines()
        file = lines[1].split(",")[lines[0].split(",").index("file")]
        (small_room / "images").mkdir()
        (table.parent / file).rename(small_room / "images" / "first.png")
        table.write_text(table.read_text().replace(file, "../../images/first.png", 1))
        done = panoloc("check", ROOT / "configs" / "global.yaml", "--set", f"dataset={small_room}")
        assert "first.png" not in done.err

    def test_a_name_longer_than_any_file_has(self, panoloc, small_room):
        table = small_room / "references" / "poses.csv"
        lines = table.read_text().splitlines()
        file = lines[1].split(",")[lines[0].split(",").index("file")]
        table.write_text(table.read_text().replace(file, "a" * 300 + ".png", 1))
        done = panoloc("build-map", small_room, "-o", "a.panomap")
        assert done.code == 2
        assert "no such file" in done.err
