"""Mitsuba, and whether this machine can run it."""
