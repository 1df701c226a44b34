"""What a data set tells about its own camera: the robot in its images, how it is mounted, and how its calibration errs."""
