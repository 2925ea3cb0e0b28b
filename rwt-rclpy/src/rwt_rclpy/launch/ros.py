"""`launch_ros`: its modules under the names in launch files."""

from __future__ import annotations

from rwt_rclpy.launch import ros_actions as actions
from rwt_rclpy.launch import ros_parameters as parameter_descriptions
from rwt_rclpy.launch import ros_substitutions as substitutions

#: The same class under its newer name.
descriptions = parameter_descriptions

__all__ = ["actions", "descriptions", "parameter_descriptions", "substitutions"]
