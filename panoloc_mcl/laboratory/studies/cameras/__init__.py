"""What is known of a camera and its place on the robot, and what errors of that cost."""
