"""Files of every kind that a user may hand over, damaged at random: each is read, or refused in a line."""

from panoloc_mcl.laboratory.studies.robustness.fuzz.inputs import Input, originals
from panoloc_mcl.laboratory.studies.robustness.fuzz.mutations import mutated
from panoloc_mcl.laboratory.studies.robustness.fuzz.study import Tally, fuzz, study

__all__ = ["Input", "Tally", "fuzz", "mutated", "originals", "study"]
