"""The demo robot's arm: kinematics, trajectories and their controller."""
