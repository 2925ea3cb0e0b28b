"""Access to robots behind a NAT: the robot's connections to a hub, and their protocol."""
