"""The commands `rwt run` and `rwt launch`, which start programs written for ROS 2."""
