"""Results folders, summaries and reports."""

from panoloc_mcl.tools.report.pages.html import render_report
from panoloc_mcl.tools.report.results.recorder import FrameRecorder
from panoloc_mcl.tools.report.results.recording import Recording
from panoloc_mcl.tools.report.results.renewal import rewrite_figures, same_metrics
from panoloc_mcl.tools.report.results.results_folder import ResultsWriter, strict_json
from panoloc_mcl.tools.report.results.results_reader import Results, read_results
from panoloc_mcl.tools.report.summary import render_summary
from panoloc_mcl.tools.report.terminal import print_metrics

__all__ = [
    "FrameRecorder",
    "Recording",
    "Results",
    "ResultsWriter",
    "print_metrics",
    "read_results",
    "render_report",
    "render_summary",
    "rewrite_figures",
    "same_metrics",
    "strict_json",
]
