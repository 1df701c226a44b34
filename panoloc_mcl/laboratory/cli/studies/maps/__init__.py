"""Studies of maps: ``panoloc study map``, ``panoloc study poses``."""
