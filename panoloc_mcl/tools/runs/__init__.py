"""Runs: a data set, a map, a localizer over every sequence, and the results folder."""
