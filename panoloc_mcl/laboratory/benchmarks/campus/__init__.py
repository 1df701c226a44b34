"""A simulated building of as many rooms as are asked for, each like the others and none the same."""
