"""A process that is killed while it writes leaves the old file or the new one, and nothing that stays in the way."""

import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from panoloc_mcl.robot.files import remove_unfinished, write_atomically

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
