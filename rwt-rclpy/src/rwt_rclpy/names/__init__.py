"""Names of ROS 2: validation, expansion, remapping, and command-line arguments."""
