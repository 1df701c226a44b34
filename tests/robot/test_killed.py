"""A process that is killed while it writes leaves the old file or the new one, and nothing that stays in the way."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from panoloc_mcl.robot.files import remove_unfinished, write_atomically
from panoloc_mcl.tools.datasets import Dataset

WRITER = """
import sys
from pathlib import Path
from panoloc_mcl.robot.files import write_atomically
print("ready", flush=True)
while True:
    for digit in "0123456789":
        write_atomically(Path(sys.argv[1]), digit * 2_000_000)
"""


@pytest.mark.slow
def test_two_hundred_kills_leave_whole_files(tmp_path: Path) -> None:
    path = tmp_path / "state"
    write_atomically(path, "x")
    rng, left, written = random.Random(0), 0, 0
    for _ in range(20):
        # Several at once: they write one file at the same time, too.
        together = [subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE) for _ in range(10)]
        for process in together:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
        for process in together:
            time.sleep(rng.uniform(0.0, 0.02))
            process.kill()
            process.wait()
            process.stdout.close()
            content = path.read_text()
            assert content == "x" or content == content[0] * 2_000_000
            written += content != "x"
        left += len(list(tmp_path.iterdir())) - 1
        remove_unfinished(tmp_path)
        assert [file.name for file in tmp_path.iterdir()] == ["state"]
    # Some were killed in the middle of it, or nothing was tried.
    assert left > 0
    assert written > 0


BUILDER = """
import os, signal, sys
from pathlib import Path
from panoloc_mcl.robot.map.panorama_map import PanoramaMap
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.datasets import read_dataset
data, to, parts, works = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), int(sys.argv[4])
votes = {"columns": 60, "components": 12, "calibration_references": 4, "virtual_places": {"threads": 1}}
config = config_from_mapping({"observation": {"votes": votes}})
told = []
def progress(done, total, what):
    if what != "references":
        if not told or told[-1] != what:
            told.append(what)
            print(what, flush=True)
        if len(told) > works and 2 * done >= total:
            os.kill(os.getpid(), signal.SIGKILL)
PanoramaMap.build(read_dataset(data), config.observation, 0, progress, config.map, parts).save(to)
"""


@pytest.mark.slow
def test_a_build_that_is_killed_in_each_of_its_works_goes_on_and_writes_the_same_bytes(
    small_room: Dataset, tmp_path: Path
) -> None:
    def build(name: str, parts: Path, works: int) -> tuple[int, list[str]]:
        command = [sys.executable, "-c", BUILDER, str(small_room.path), str(tmp_path / name), str(parts), str(works)]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=300)
        return done.returncode, done.stdout.splitlines()

    code, every = build("whole", tmp_path / "never", 1000)
    assert code == 0
    assert {"depth of references", "pairs of keyframes", "poses of references", "views", "calibration"} <= set(every)
    # Killed halfway through each work: what was done before it is not done again, but for the views of the basis, which are few.
    basis = every.index("views")
    for number, work in enumerate(every):
        again = ["views"] if number > basis + 1 else []
        code, told = build("killed", tmp_path / "parts", min(number, 1) + len(again))
        assert code == -signal.SIGKILL
        assert told == again + every[max(number - 1, 0) : number + 1], work
        assert not (tmp_path / "killed").exists()
    code, told = build("killed", tmp_path / "parts", 1000)
    assert (code, told) == (0, ["views", *every[-1:]])
    assert (tmp_path / "killed").read_bytes() == (tmp_path / "whole").read_bytes()
