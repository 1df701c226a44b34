"""Files of every kind that a user may hand over, damaged at random: each is read, or refused in a line."""

from panoloc_mcl.laboratory.studies.fuzz.inputs import Input, originals
from panoloc_mcl.laboratory.studies.fuzz.mutations import mutated
from panoloc_mcl.laboratory.studies.fuzz.study import Tally, fuzz, study

__all__ = ["Input", "Tally", "fuzz", "mutated", "originals", "study"]
