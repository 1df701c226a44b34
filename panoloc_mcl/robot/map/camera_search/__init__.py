"""What images of a world of walls and a floor tell about the camera that took them: a search over numbers of its description."""
