"""Packages that programs import besides rclpy: tf2_ros, message_filters, rosidl_runtime_py and others."""
