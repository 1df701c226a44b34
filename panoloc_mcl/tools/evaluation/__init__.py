"""Figures of runs: records in, metrics and tables out."""

from panoloc_mcl.tools.evaluation.definitions import METRICS_SCHEMA
from panoloc_mcl.tools.evaluation.metrics import evaluate
from panoloc_mcl.tools.evaluation.record import SequenceRecord
from panoloc_mcl.tools.evaluation.tables import Row, Section, Table, metrics_table, paper_table
from panoloc_mcl.tools.evaluation.wilson import wilson95

__all__ = [
    "METRICS_SCHEMA",
    "Row",
    "Section",
    "SequenceRecord",
    "Table",
    "evaluate",
    "metrics_table",
    "paper_table",
    "wilson95",
]
