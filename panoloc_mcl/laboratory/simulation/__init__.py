"""Worlds to try the localizer in: scenes, the light of the day, cameras and robots. Mitsuba 3 carries the light.

Needs the extra ``simulate``; Mitsuba is imported in `panoloc_mcl.laboratory.simulation.renderer` alone, and only when it is used.
"""
