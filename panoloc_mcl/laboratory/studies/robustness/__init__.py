"""Faults, kills, damaged files, and places where nobody can know."""
