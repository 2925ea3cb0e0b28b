"""robot_state_publisher: description of a robot, and the transforms of its links from joint states."""
