"""Comparisons: a matrix of runs, on one machine or many, and what differs between them."""

from panoloc_mcl.laboratory.comparison.matrix import Cell, Matrix, load_matrix, matrix_from_mapping
from panoloc_mcl.laboratory.comparison.study import Study, compare

__all__ = ["Cell", "Matrix", "Study", "compare", "load_matrix", "matrix_from_mapping"]
