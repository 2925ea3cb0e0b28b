"""Names of ROS 2: validation, expansion, remapping, and the arguments of the command line."""
