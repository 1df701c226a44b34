"""Compiled inner loops: arrays and scalars in, arrays out. They import nothing of the package and hold no state."""
