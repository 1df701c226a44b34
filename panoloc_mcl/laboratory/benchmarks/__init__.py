"""Benchmarks: times and memory as ratios against named peers, measured in turns in one run."""
