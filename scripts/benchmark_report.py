"""What pictures cost: writing the report as a share of the run it reports, its size, and memory over many frames. Prints Markdown.

    python scripts/benchmark_report.py [--dataset PATH_OR_NAME] [--frames N] [--repeats N]

Run and report alternate in one process, and the medians' ratio is shown; the run records its frames, as every run does. The memory is
that of a process of its own over all drives of the data set, again and again with other seeds until there are enough frames.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.report import Recording, read_results, render_report
from panoloc_mcl.tools.runs.pipeline import run

_LONG_RUN = """
import sys
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.runs.pipeline import run
dataset, out, runs = sys.argv[1], sys.argv[2], int(sys.argv[3])
outcome = run(config_from_mapping({"dataset": dataset, "out": out, "runs": runs}))
status = open("/proc/self/status").read().splitlines()
peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024
print(outcome.metrics["overall"]["frames"], peak, (outcome.folder / "report.html").stat().st_size / 1e6)
"""


def report_share(dataset: str, repeats: int) -> None:
    """Print the time of a report as a share of that of its run."""
    runs, reports, size, frames = [], [], 0, 0
    with tempfile.TemporaryDirectory() as folder:
        config = config_from_mapping({"dataset": dataset, "out": folder})
        run(config)  # compiles, renders, builds the map
        for _ in range(repeats):
            begin = time.perf_counter()
            outcome = run(config)
            whole = time.perf_counter() - begin
            results = read_results(outcome.folder)
            begin = time.perf_counter()
            text = render_report(
                outcome.metrics, results.run_info, results.records, results.place_positions, results.path, results.place_files
            )
            reports.append(time.perf_counter() - begin)
            # The run wrote the same report at its end.
            runs.append(whole - reports[-1])
            size, frames = len(text.encode()), sum(len(record) for record in results.records)
        recorded = sum(len(Recording.load(path)) for path in results.path.glob("*/run_*/frames.npz"))
    share = statistics.median(reports) / statistics.median(runs)
    print("\n## Writing the report\n\n| what | figure |\n|---|---|")
    print(f"| frames of the run, recorded | {frames}, {recorded} |")
    print(f"| time of the report / time of the run | {share:.3f} |")
    print(f"| size of the report | {size / 1e6:.1f} MB |")


def long_run(dataset: str, frames: int) -> None:
    """Print peak memory and report size of a run over at least so many frames."""
    with tempfile.TemporaryDirectory() as folder:
        once = sum(
            len(record) for record in read_results(run(config_from_mapping({"dataset": dataset, "out": folder})).folder).records
        )
        command = [sys.executable, "-c", _LONG_RUN, dataset, folder, str(-(-frames // once))]
        done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=Path.cwd())
    count, peak, size = done.stdout.split()
    print(f"\n## A run of {count} frames\n\n| what | figure |\n|---|---|")
    print(f"| peak memory | {float(peak):.0f} MB |")
    print(f"| size of the report | {float(size):.1f} MB |")


def main() -> None:
    """Run both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dataset", default="hall", help="path of a data set, or the name of an embedded one")
    parser.add_argument("--frames", type=int, default=500)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    report_share(arguments.dataset, arguments.repeats)
    long_run(arguments.dataset, arguments.frames)


if __name__ == "__main__":
    main()
