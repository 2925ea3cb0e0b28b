"""Joints: limits, units of motors, and the controller that follows trajectories."""
