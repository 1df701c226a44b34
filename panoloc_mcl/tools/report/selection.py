"""Which runs to picture when there are too many of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest

from panoloc_mcl.tools.evaluation.record import SequenceRecord


def pictured(records: Sequence[SequenceRecord], most: int) -> list[SequenceRecord]:
    """First run of each sequence; when those are more than ``most``, the groups take turns. Ordered by name."""
    first: dict[str, SequenceRecord] = {}
    for record in sorted(records, key=lambda r: (r.name, r.run)):
        first.setdefault(record.name, record)
    groups: dict[str, list[SequenceRecord]] = {}
    for record in first.values():
        groups.setdefault(record.group, []).append(record)
    turns = [record for turn in zip_longest(*groups.values()) for record in turn if record is not None]
    return sorted(turns[:most], key=lambda r: r.name)
