"""How things are called: which names ROS allows, how they are expanded and remapped, and the command line."""
