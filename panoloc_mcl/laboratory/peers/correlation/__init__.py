"""Peers that correlate gradients with every reference around the circle."""
