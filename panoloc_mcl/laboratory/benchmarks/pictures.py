"""What pictures cost: writing the report as a share of the run it reports, its size, and memory over many frames."""

from __future__ import annotations

import tempfile
import time

from panoloc_mcl.laboratory.reports import Number, Ratio, Report
from panoloc_mcl.laboratory.timing import in_a_process
from panoloc_mcl.tools.config import config_from_mapping
from panoloc_mcl.tools.report import Recording, read_results, render_report
from panoloc_mcl.tools.runs.pipeline import run


def pictures(dataset: str, repeats: int, frames: int) -> Report:
    """Time and size of a report; peak memory of a process that runs over at least so many frames, its drives again and again."""
    runs, reports, size, count = [], [], 0, 0
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
            size, count = len(text.encode()), sum(len(record) for record in results.records)
        recorded = sum(len(Recording.load(path)) for path in results.path.glob("*/run_*/frames.npz"))
        many = in_a_process(f"{__name__}:long_run", dataset, folder, str(-(-frames // count)))
    report = Report(f"The report of a run over `{dataset}`, {repeats} rounds.")
    table = report.table("Writing the report", ("what", "figure"))
    table.add("frames of the run", count)
    table.add("frames recorded", recorded)
    table.add("time of the report / time of the run (95 %)", Ratio.of(reports, runs))
    table.add("size of the report, MB", Number(size / 1e6, 1))
    table = report.table(f"A run of {many['frames']} frames", ("what", "figure"))
    table.add("peak memory, MB", Number(many["peak_mb"]))
    table.add("size of the report, MB", Number(many["report_mb"], 1))
    return report


def long_run(dataset: str, out: str, runs: str) -> dict[str, float]:
    """Run in this process: frames, and size of the report."""
    outcome = run(config_from_mapping({"dataset": dataset, "out": out, "runs": int(runs)}))
    size = (outcome.folder / "report.html").stat().st_size / 1e6
    return {"frames": outcome.metrics["overall"]["frames"], "report_mb": size}
