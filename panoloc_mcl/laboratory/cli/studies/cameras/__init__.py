"""Studies of cameras: ``panoloc study camera``, ``panoloc study mount``, ``panoloc study yaw``."""
