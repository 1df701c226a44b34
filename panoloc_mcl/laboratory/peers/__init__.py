"""Observation models that the default one is compared with: the paper's voting and the cited peers."""
