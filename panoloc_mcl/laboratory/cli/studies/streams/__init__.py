"""Studies of streams: ``panoloc study layouts``, ``panoloc study racing``."""
