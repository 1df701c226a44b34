"""The map: what is built from the reference panoramas, and the file it is kept in."""
