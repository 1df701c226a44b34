"""The arguments of each study."""
