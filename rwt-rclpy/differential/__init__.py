"""Comparison of this rclpy with the real one: both run the same programs, and their output is compared."""
