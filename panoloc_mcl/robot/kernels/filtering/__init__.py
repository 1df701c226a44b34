"""Inner loops over particles: moved, weighed, drawn anew, grouped; their random numbers."""
