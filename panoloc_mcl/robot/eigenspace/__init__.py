"""What images are turned into before they are compared: local orientations, filter responses, eigenimages."""
