"""The journey of a robot's owner, from an environment with only `rclpy` and its rmw: `make ros2-owner`."""
