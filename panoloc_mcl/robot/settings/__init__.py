"""Settings of the robot's parts, and how they are checked."""
