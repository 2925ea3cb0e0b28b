"""Types on ROS 2: definitions that nodes describe, type supports made from definitions, and raw services."""
