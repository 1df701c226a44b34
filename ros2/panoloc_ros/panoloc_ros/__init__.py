"""panoloc_mcl as a ROS 2 lifecycle node, in the place of nav2's AMCL."""
