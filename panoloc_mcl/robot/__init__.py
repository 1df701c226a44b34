"""What runs on the robot: camera, eigenspace, synthesis, observation, filters, motion, the map and the localizer."""
