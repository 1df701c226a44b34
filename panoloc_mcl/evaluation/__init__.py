"""Figures of runs: records in, metrics and tables out."""

from panoloc_mcl.evaluation.definitions import METRICS_SCHEMA
from panoloc_mcl.evaluation.metrics import evaluate
from panoloc_mcl.evaluation.record import SequenceRecord
from panoloc_mcl.evaluation.tables import Row, Section, Table, metrics_table, paper_table
from panoloc_mcl.evaluation.wilson import wilson95

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
