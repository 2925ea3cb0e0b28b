"""A simulated robot, written on the public graph API as a user would write one."""
