"""How is a program that was written for ROS 2 started here: `rwt run`, `rwt launch`."""
