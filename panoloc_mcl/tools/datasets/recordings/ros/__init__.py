"""Bags of ROS 1 and ROS 2 and MCAP files (extra ``bags``): `reading` is where it begins."""
