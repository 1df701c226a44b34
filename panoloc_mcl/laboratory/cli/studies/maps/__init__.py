"""Studies of maps: ``panoloc study map``, ``panoloc study poses``, ``panoloc study frame``, ``panoloc study colmap``."""
