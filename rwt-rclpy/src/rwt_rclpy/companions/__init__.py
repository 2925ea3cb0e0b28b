"""The packages that programs import beside rclpy: tf2_ros, message_filters, rosidl_runtime_py and others."""
