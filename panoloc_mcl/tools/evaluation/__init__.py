"""Figures of runs: records in, metrics and tables out."""

from panoloc_mcl.tools.evaluation.consistency import consistency
from panoloc_mcl.tools.evaluation.definitions import METRICS_SCHEMA
from panoloc_mcl.tools.evaluation.intervals import bootstrap95, interval95_over_drives, quantile95_over_drives, wilson95
from panoloc_mcl.tools.evaluation.metrics import evaluate
from panoloc_mcl.tools.evaluation.record import SequenceRecord
from panoloc_mcl.tools.evaluation.tables import Row, Section, Table, metrics_table, paper_table

__all__ = [
    "METRICS_SCHEMA",
    "Row",
    "Section",
    "SequenceRecord",
    "Table",
    "bootstrap95",
    "consistency",
    "evaluate",
    "interval95_over_drives",
    "metrics_table",
    "paper_table",
    "quantile95_over_drives",
    "wilson95",
]
