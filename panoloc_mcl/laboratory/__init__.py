"""The laboratory: simulation, corruptions, models to compare with, comparisons and studies."""
