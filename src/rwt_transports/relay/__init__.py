"""Reaching a robot behind a NAT: the hub, the robot's connections to it, and what they say to each other."""
