"""MuJoCo models as robots: physics, cameras, sensors, and the six-joint arm of this project."""
